#!/usr/bin/env bash
# An FMU of pythonfmu whose module only derives a class from another one: the first instance works, the second ends the process.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3.11 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet pythonfmu==0.7.0 fmpy==0.3.32
cat > "$folder/base.py" <<'PYTHON'
from pythonfmu import Fmi2Causality, Fmi2Slave, Real


class Base(Fmi2Slave):
    def __init__(self, **kwargs):
        super().__init__(**kwargs)
        self.y = 1.0
        self.register_variable(Real("y", causality=Fmi2Causality.output))

    def do_step(self, current_time, step_size):
        return True
PYTHON
printf 'import base\n\n\nclass Once(base.Base):\n    pass\n' > "$folder/once.py"
cat > "$folder/try.py" <<'PYTHON'
import fmpy
from fmpy.simulation import instantiate_fmu

folder, description = fmpy.extract("Once.fmu"), fmpy.read_model_description("Once.fmu")
for number in (1, 2):
    fmu = instantiate_fmu(folder, description, "CoSimulation")
    fmu.setupExperiment(startTime=0.0)
    fmu.enterInitializationMode()
    fmu.exitInitializationMode()
    fmu.terminate()
    fmu.freeInstance()
    print(f"instance {number} works", flush=True)
PYTHON
cd "$folder"
venv/bin/pythonfmu build -f once.py -d . base.py > built 2>&1
code=0
venv/bin/python try.py > seen 2> errors || code=$?
cat seen
echo "pythonfmu 0.7.0, FMPy 0.3.32: two instances of an FMU, one after the other in one process; exit code $code"
echo "guess: two lines"
echo "seen:  one line, then a segmentation fault (or 'Failed to instantiate model'); findClass releases the module's dictionary, which PyModule_GetDict only lends"
echo "instance 1 works" | cmp - seen
test "$code" -ne 0
