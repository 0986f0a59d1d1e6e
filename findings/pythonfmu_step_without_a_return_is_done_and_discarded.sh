#!/usr/bin/env bash
# pythonfmu: a do_step that returns nothing does its step and reports it as discarded, which for an importer means that it was not done.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3.11 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet fmpy==0.3.32 pythonfmu==0.7.0
cat > "$folder/counter.py" <<'PYTHON'
from pythonfmu import Fmi2Causality, Fmi2Slave, Real


class Counter(Fmi2Slave):
    def __init__(self, **options):
        super().__init__(**options)
        self.n = 0.0
        self.register_variable(Real("n", causality=Fmi2Causality.output))

    def do_step(self, time, step):
        self.n += 1
PYTHON
cat > "$folder/try.py" <<'PYTHON'
import fmpy

model = fmpy.read_model_description("Counter.fmu", validate=False)
fmu = fmpy.instantiate_fmu(fmpy.extract("Counter.fmu"), model, "CoSimulation")
fmu.setupExperiment(startTime=0.0)
fmu.enterInitializationMode()
fmu.exitInitializationMode()
(n,) = [v.valueReference for v in model.modelVariables if v.name == "n"]
for time in (0.0, 0.1):
    try:
        fmu.doStep(time, 0.1)
    except Exception as exc:
        print(exc, fmu.getReal([n]))
PYTHON
(cd "$folder" && venv/bin/pythonfmu build -f counter.py -d . >built 2>&1 && TMPDIR="$folder" venv/bin/python try.py 2>stderr) | tee "$folder/seen"
echo "pythonfmu 0.7.0, FMPy 0.3.32: do_step returns None; n counts the steps"
echo "guess: a step that raises nothing counts as done, or an error says that the return value is missing"
echo "seen:  discard, which in FMI leaves the state as it was, and n has counted"
printf 'fmi2DoStep failed with status 2 (discard). [1.0]\nfmi2DoStep failed with status 2 (discard). [2.0]\n' | cmp - "$folder/seen"
