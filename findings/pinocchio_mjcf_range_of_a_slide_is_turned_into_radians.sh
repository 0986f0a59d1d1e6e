#!/usr/bin/env bash
# Pinocchio converts the range of a slide joint from degrees, as if metres were angles.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3.11 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet mujoco==4.0.0 pin==4.1.0
cat > "$folder/model.xml" <<'XML'
<mujoco>
  <worldbody>
    <body name="b"><joint name="j" type="slide" axis="0 0 1" range="-1 2"/><geom size="0.1" pos="0.2 0 0"/></body>
  </worldbody>
</mujoco>
XML
cat > "$folder/read.py" <<'PYTHON'
import sys
import mujoco, numpy as np, pinocchio as pin

path = sys.argv[1]
one = mujoco.MjModel.from_xml_path(path)
other = pin.buildModelFromMJCF(path)
print("MuJoCo", *one.jnt_range[0])
print("Pinocchio", *np.round([other.lowerPositionLimit[0], other.upperPositionLimit[0]], 6))
PYTHON
"$folder/venv/bin/python" "$folder/read.py" "$folder/model.xml" | tee "$folder/seen"
echo "mujoco 4.0.0, pin 4.1.0"
echo "guess: degrees are for hinges: -1 and 2 m in both"
echo "seen:  Pinocchio has -0.017 to 0.035 m; with <compiler angle=radian> it has -1 to 2"
printf 'MuJoCo -1.0 2.0\nPinocchio -0.017453 0.034907\n' | cmp - "$folder/seen"
