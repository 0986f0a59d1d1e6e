#!/usr/bin/env bash
# Pinocchio: randomConfiguration of a model with a free base returns an infinite position, and raises nothing.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3.11 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet pin==4.1.0
cat > "$folder/try.py" <<'PYTHON'
import numpy as np
import pinocchio

model = pinocchio.Model()
model.addJoint(0, pinocchio.JointModelFreeFlyer(), pinocchio.SE3.Identity(), "base")
pose = pinocchio.randomConfiguration(model)
print(pose[:3], np.isclose(np.linalg.norm(pose[3:]), 1.0))
data = model.createData()
pinocchio.forwardKinematics(model, data, pose)
print(data.oMi[1].translation)
PYTHON
(cd "$folder" && venv/bin/python try.py 2>stderr) | tee "$folder/seen"
echo "pin 4.1.0 (Pinocchio)"
echo "guess: an error that says the base has no limits, or a pose in a box of some metres"
echo "seen:  inf for x, y and z, from which the kinematics make not-a-number; the rotation is a rotation"
printf '[inf inf inf] True\n[nan nan nan]\n' | cmp - "$folder/seen"
