#!/usr/bin/env bash
# FMPy: in the table of a co-simulation, the input of a row is the one of a step earlier, since it is set before a step and read after it.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3.11 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet fmpy==0.3.32 pythonfmu==0.7.0
cat > "$folder/try.py" <<'PYTHON'
import fmpy
import numpy as np
from pythonfmu import FmuBuilder

SLAVE = """
from pythonfmu import Fmi2Causality, Fmi2Slave, Real

class Gain(Fmi2Slave):
    def __init__(self, **options):
        super().__init__(**options)
        self.u = 0.0
        self.register_variable(Real("u", causality=Fmi2Causality.input))

    def do_step(self, time, step):
        return True
"""
with open("gain.py", "w") as file:
    file.write(SLAVE)
ramp = np.array([(0.0, 0.0), (1.0, 1.0)], dtype=[("time", float), ("u", float)])
fmu = FmuBuilder.build_FMU("gain.py", dest=".")
print("time input")
for row in fmpy.simulate_fmu(str(fmu), stop_time=1, output_interval=0.5, input=ramp, output=["u"]).tolist():
    print(*row)
PYTHON
(cd "$folder" && venv/bin/python try.py 2>stderr) | tee "$folder/seen"
echo "FMPy 0.3.32, pythonfmu 0.7.0: an input that rises from 0 at 0 s to 1 at 1 s, recorded each half second"
echo "guess: the input of each time: 0 0.5 1"
echo "seen:  0 0 0.5"
printf 'time input\n0.0 0.0\n0.5 0.0\n1.0 0.5\n' | cmp - "$folder/seen"
