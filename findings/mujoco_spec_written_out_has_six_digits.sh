#!/usr/bin/env bash
# mujoco: MjSpec.to_xml writes six digits, so the model of the text is another one than that of the spec.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3.11 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet mujoco==4.0.0
cat > "$folder/try.py" <<'PYTHON'
import mujoco

spec = mujoco.MjSpec()
body = spec.worldbody.add_body(name="box", pos=[1 / 3, 0.123456789, 0])
body.add_freejoint()
body.add_geom(type=mujoco.mjtGeom.mjGEOM_BOX, size=[0.1, 0.1, 0.1], mass=1 / 3)
model = spec.compile()
written = mujoco.MjModel.from_xml_string(spec.to_xml())
print(f"position off by {abs(model.body_pos[1] - written.body_pos[1]).max():.1e} m")
print(f"mass off by {abs(model.body_mass[1] - written.body_mass[1]):.1e} kg")
PYTHON
(cd "$folder" && venv/bin/python try.py 2>stderr) | tee "$folder/seen"
echo "mujoco 4.0.0: a body at (1/3, 0.123456789, 0) of 1/3 kg, compiled as it is and from its to_xml()"
echo "guess: the same model"
echo "seen:  a third is 0.333333: the position is 3.3e-7 m off, the mass 3.3e-7 kg"
printf 'position off by 3.3e-07 m\nmass off by 3.3e-07 kg\n' | cmp - "$folder/seen"
