#!/usr/bin/env bash
# xacro: a property of text that Python reads as a number becomes that number: "007" is 7, "infinity" is inf.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3.11 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet xacro==2.1.1
cat > "$folder/try.py" <<'PYTHON'
import subprocess

VALUES = ("007", "1e3", "infinity", "1_2", "0x10")
links = "".join(
    f"""<xacro:property name="serial" value="{value}"/><link name="arm_${{serial}}"/>"""
    for value in VALUES
)
with open("robot.xacro", "w") as file:
    file.write(f"""<robot name="r" xmlns:xacro="http://www.ros.org/wiki/xacro">{links}</robot>""")
made = subprocess.run(["venv/bin/xacro", "robot.xacro"], check=True, capture_output=True, text=True)
print(*(line.split(chr(34))[1] for line in made.stdout.splitlines() if "<link" in line))
PYTHON
(cd "$folder" && venv/bin/python try.py 2>stderr) | tee "$folder/seen"
echo "xacro 2.1.1"
echo "guess: arm_007 arm_1e3 arm_infinity arm_1_2 arm_0x10: the text as it was written"
echo "seen:  arm_7 arm_1000.0 arm_inf, and the last two as written"
printf 'arm_7 arm_1000.0 arm_inf arm_1_2 arm_0x10\n' | cmp - "$folder/seen"
