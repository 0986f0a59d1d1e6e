#!/usr/bin/env bash
# python-control: input_output_response chooses its own time steps, and steps over a pulse of nine samples; forced_response has it.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3.11 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet control==0.10.2
cat > "$folder/try.py" <<'PYTHON'
import control
import numpy as np

times = np.linspace(0, 10, 1001)
pulse = np.zeros(1001)
pulse[500:509] = 1
integrator = control.ss([[0]], [[1]], [[1]], [[0]])
for respond in (control.input_output_response, control.forced_response):
    print(respond.__name__, f"{float(np.max(respond(integrator, times, pulse).outputs)):.2f}")
PYTHON
(cd "$folder" && venv/bin/python try.py 2>stderr) | tee "$folder/seen"
echo "python-control 0.10.2: an integrator, 1001 samples in 10 s, the input 1 in nine of them and 0 otherwise; the largest output"
echo "guess: 0.09 of both"
echo "seen:  0 of input_output_response, without a warning"
printf 'input_output_response 0.00\nforced_response 0.09\n' | cmp - "$folder/seen"
