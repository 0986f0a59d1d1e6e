#!/usr/bin/env bash
# pythonfmu: the smallest FMU with an output lacks it among the initial unknowns; FMPy's validation refuses that.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3.11 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet pythonfmu==0.7.0 fmpy==0.3.32
cat > "$folder/small.py" <<'PYTHON'
from pythonfmu import Fmi2Causality, Fmi2Slave, Real


class Small(Fmi2Slave):
    def __init__(self, **kwargs):
        super().__init__(**kwargs)
        self.y = 1.0
        self.register_variable(Real("y", causality=Fmi2Causality.output))

    def do_step(self, current_time, step_size):
        return True
PYTHON
cd "$folder"
venv/bin/pythonfmu build -f small.py -d . > built 2>&1
venv/bin/python -c 'from fmpy.validation import validate_fmu; print(*validate_fmu("Small.fmu"), sep="\n")' | tee seen
echo "pythonfmu 0.7.0, FMPy 0.3.32: validate_fmu of an FMU with one output"
echo "guess: no problems"
echo "seen:  InitialUnknowns is empty; an output that is calculated, which is the default, has to be in it"
echo 'ModelStructure/InitialUnknowns does not contain the expected set of variables. Expected {y} but was {}.' | cmp - seen
