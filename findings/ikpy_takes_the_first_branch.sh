#!/usr/bin/env bash
# ikpy: where a link has two children, the chain is the first of the file; the other is not mentioned.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3.11 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet ikpy==4.2.1
cat > "$folder/try.py" <<'PYTHON'
import warnings

from ikpy.chain import Chain

LIMIT = '<limit lower="-1" upper="1" effort="1" velocity="1"/>'
JOINT = '<joint name="{0}" type="revolute"><parent link="base"/><child link="{0}_arm"/><axis xyz="0 0 1"/>' + LIMIT + "</joint>"
ROBOT = (
    '<robot name="robot"><link name="base"/><link name="left_arm"/><link name="right_arm"/>'
    + JOINT.format("left") + JOINT.format("right") + "</robot>"
)
with open("robot.urdf", "w") as file:
    file.write(ROBOT)
with warnings.catch_warnings(record=True) as seen:
    warnings.simplefilter("always")
    chain = Chain.from_urdf_file("robot.urdf", base_elements=["base"])
print("base", *(link.name for link in chain.links[1:]))
print("warnings of the right arm:", sum("right" in str(warning.message) for warning in seen))
PYTHON
(cd "$folder" && venv/bin/python try.py 2>stderr) | tee "$folder/seen"
echo "ikpy 4.2.1: a base with two arms, left before right, Chain.from_urdf_file"
echo "guess: an error that asks which"
echo "seen:  the left arm, without a word of the right one"
printf 'base left\nwarnings of the right arm: 0\n' | cmp - "$folder/seen"
