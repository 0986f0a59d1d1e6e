#!/usr/bin/env bash
# Pinocchio: the total mass, and the centre of mass, are those of what moves; the base of a fixed robot counts with a free base only.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3.11 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet pin==4.1.0
cat > "$folder/try.py" <<'PYTHON'
import pinocchio

LINK = '<link name="{}"><inertial><mass value="{}"/><inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial></link>'
ROBOT = (
    '<robot name="robot">' + LINK.format("base", 5) + LINK.format("arm", 2)
    + '<joint name="shoulder" type="continuous"><parent link="base"/><child link="arm"/><axis xyz="0 0 1"/></joint></robot>'
)
print(f"fixed {pinocchio.computeTotalMass(pinocchio.buildModelFromXML(ROBOT)):.0f} kg")
free = pinocchio.buildModelFromXML(ROBOT, pinocchio.JointModelFreeFlyer())
print(f"free {pinocchio.computeTotalMass(free):.0f} kg")
PYTHON
(cd "$folder" && venv/bin/python try.py 2>stderr) | tee "$folder/seen"
echo "pin 4.1.0: a base of 5 kg and an arm of 2 kg; computeTotalMass with a fixed and with a free base"
echo "guess: 7 kg both times"
echo "seen:  2 kg fixed, 7 kg free"
printf 'fixed 2 kg\nfree 7 kg\n' | cmp - "$folder/seen"
