#!/usr/bin/env bash
# MuJoCo: a geom with margin 10 mm and gap 5 mm rests 5 mm higher in 4.0.0 than in 3.3.7: gap lay within the margin there, and lies beyond it now.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3.11 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet mujoco==4.0.0 numpy==2.4.6
python3.11 -m venv "$folder/old"
"$folder/old/bin/pip" install --quiet mujoco==3.3.7 numpy==2.4.6
cat > "$folder/run.py" <<'PYTHON'
import mujoco

MODEL = """<mujoco><option timestep="0.001"/><worldbody><geom type="plane" size="1 1 .1"/>
<body pos="0 0 .13"><freejoint/><geom type="sphere" size=".1" margin=".01" gap="{}"/></body>
</worldbody></mujoco>"""
with open("seen", "a") as seen:
    for gap in (0, 0.005, 0.01):
        model = mujoco.MjModel.from_xml_string(MODEL.format(gap))
        data = mujoco.MjData(model)
        first = None
        for _ in range(3000):
            mujoco.mj_step(model, data)
            if first is None and data.ncon:
                first = 1e3 * data.contact[0].dist
        rest = 1e3 * (data.qpos[2] - 0.1)
        name = f"{mujoco.__version__} gap {gap}"
        print(f"{name}: contact from {first:.0f} mm on, rests at {rest:.1f} mm", file=seen)
PYTHON
cd "$folder"
old/bin/python run.py
venv/bin/python run.py
echo "mujoco 4.0.0 and 3.3.7: a ball with margin=0.01 above a plane"
echo "guess: the same in both: a contact from 10 mm on, and a force from margin - gap on"
echo "seen:"
cat seen
cmp - seen <<'SEEN'
3.3.7 gap 0: contact from 10 mm on, rests at 9.6 mm
3.3.7 gap 0.005: contact from 10 mm on, rests at 4.6 mm
3.3.7 gap 0.01: contact from 10 mm on, rests at -0.4 mm
4.0.0 gap 0: contact from 10 mm on, rests at 9.6 mm
4.0.0 gap 0.005: contact from 15 mm on, rests at 9.6 mm
4.0.0 gap 0.01: contact from 20 mm on, rests at 9.6 mm
SEEN
