#!/usr/bin/env bash
# MuJoCo: the mass of a closed L-shaped mesh is 24 % above density times volume, unless the asset says inertia="exact".
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3.11 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet mujoco==4.0.0 trimesh==5.2.0 shapely==2.1.2 mapbox-earcut==2.0.0
cat > "$folder/run.py" <<'PYTHON'
import sys

import mujoco
import trimesh
from shapely.geometry import Polygon

corner = Polygon([(0, 0), (2, 0), (2, 0.5), (0.5, 0.5), (0.5, 2), (0, 2)])
mesh = trimesh.creation.extrude_polygon(corner, 0.5)
assert mesh.is_watertight
BODY = """<mujoco><asset><mesh name="L" file="L.obj" {}/></asset><worldbody>
<body><freejoint/><geom type="mesh" mesh="L" density="1"/></body></worldbody></mujoco>"""
files = {"L.obj": mesh.export(file_type="obj").encode()}
with open(sys.argv[1], "w") as seen:
    print(f"trimesh {mesh.volume:.5f}", file=seen)
    for name, how in (("default", ""), ('inertia="exact"', 'inertia="exact"')):
        model = mujoco.MjModel.from_xml_string(BODY.format(how), files)
        print(f"mujoco, {name} {model.body_mass[1]:.5f}", file=seen)
PYTHON
cd "$folder"
venv/bin/python run.py seen >/dev/null 2>&1
echo "mujoco 4.0.0, trimesh 5.2.0"
echo "guess: a closed mesh weighs density times volume by default, 0.875"
echo "seen:"
cat seen
printf 'trimesh 0.87500\nmujoco, default 1.08198\nmujoco, inertia="exact" 0.87500\n' | cmp - seen
