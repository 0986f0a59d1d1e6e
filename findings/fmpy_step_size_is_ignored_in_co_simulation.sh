#!/usr/bin/env bash
# FMPy: simulate_fmu takes step_size for co-simulation and ignores it; output_interval is the step.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3.11 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet fmpy==0.3.32 pythonfmu==0.7.0
cat > "$folder/try.py" <<'PYTHON'
import subprocess

with open("probe.py", "w") as file:
    file.write("""
from pythonfmu import Fmi2Causality, Fmi2Slave, Real


class Probe(Fmi2Slave):
    def __init__(self, **arguments):
        super().__init__(**arguments)
        self.step = 0.0
        self.register_variable(Real("step", causality=Fmi2Causality.output))

    def do_step(self, time, step):
        self.step = step
        return True
""")
subprocess.run(["venv/bin/pythonfmu", "build", "-f", "probe.py"], check=True, capture_output=True)
import fmpy

for words in ({"step_size": 0.1}, {"step_size": 0.1, "output_interval": 0.25}):
    result = fmpy.simulate_fmu("Probe.fmu", stop_time=1.0, **words)
    print(len(result), round(result["step"][-1], 6))
PYTHON
(cd "$folder" && venv/bin/python try.py 2>stderr) | tee "$folder/seen"
echo "FMPy 0.3.32, an FMU for FMI 2 made by pythonfmu 0.7.0"
echo "guess: step_size=0.1 steps by 0.1 s, both times"
echo "seen:  by 0.002 s (a 500th of the run), and by 0.25 s"
printf '501 0.002\n5 0.25\n' | cmp - "$folder/seen"
