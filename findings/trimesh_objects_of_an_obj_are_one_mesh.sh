#!/usr/bin/env bash
# trimesh: an OBJ with two objects comes as one mesh, its names are gone; a GLB with two nodes comes as a scene.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3.11 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet numpy==2.4.6 trimesh==5.2.0
cat > "$folder/run.py" <<'PYTHON'
import io
import sys

import trimesh

OBJ = "o a\nv 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\no b\nv 0 0 1\nv 1 0 1\nv 0 1 1\nf 4 5 6\n"
both = trimesh.Scene({"a": trimesh.creation.box(), "b": trimesh.creation.box()})
with open(sys.argv[1], "w") as seen:
    for kind, data in (("obj", OBJ.encode()), ("glb", both.export(file_type="glb"))):
        got = trimesh.load(io.BytesIO(data), file_type=kind)
        names = f" of {', '.join(sorted(got.geometry))}" if isinstance(got, trimesh.Scene) else ""
        print(f"{kind}: {type(got).__name__}{names}", file=seen)
PYTHON
cd "$folder"
venv/bin/python run.py seen >/dev/null 2>&1
echo "trimesh 5.2.0"
echo "guess: load of a file with two objects gives a scene with two meshes, whatever the format"
echo "seen:"
cat seen
printf 'obj: Trimesh\nglb: Scene of a, b\n' | cmp - seen
