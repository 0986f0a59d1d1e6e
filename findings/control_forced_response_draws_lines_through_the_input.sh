#!/usr/bin/env bash
# python-control: forced_response takes lines between the samples of an input, so a step that a controller holds begins one sample early.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3.11 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet control==0.10.2
cat > "$folder/try.py" <<'PYTHON'
import control

response = control.forced_response(control.tf([1], [1, 0]), [0, 1, 2, 3], [0, 1, 1, 1])
print(*(f"{value:.6g}" for value in response.outputs))
PYTHON
(cd "$folder" && venv/bin/python try.py 2>stderr) | tee "$folder/seen"
echo "python-control 0.10.2: 1/s with the inputs 0 1 1 1 at the times 0 1 2 3"
echo "guess: 0 0 1 2, each input held until the next"
echo "seen:  0 0.5 1.5 2.5, a ramp from the first sample to the second"
printf '0 0.5 1.5 2.5\n' | cmp - "$folder/seen"
