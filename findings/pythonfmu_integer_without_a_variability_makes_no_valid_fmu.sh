#!/usr/bin/env bash
# pythonfmu: an Integer, Boolean or String without a variability is written as a continuous one, which FMI 2 forbids: FMPy refuses the FMU.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3.11 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet fmpy==0.3.32 pythonfmu==0.7.0
cat > "$folder/try.py" <<'PYTHON'
import fmpy
from pythonfmu import FmuBuilder

SLAVE = """
from pythonfmu import *

class Counter(Fmi2Slave):
    def __init__(self, **options):
        super().__init__(**options)
        self.n = 0
        self.register_variable(Integer("n", causality=Fmi2Causality.output{}))

    def do_step(self, time, step):
        self.n += 1
        return True
"""
for more in ("", ", variability=Fmi2Variability.discrete"):
    with open("counter.py", "w") as file:
        file.write(SLAVE.format(more))
    fmu = FmuBuilder.build_FMU("counter.py", dest=".")
    try:
        print(fmpy.read_model_description(str(fmu)).modelVariables[0].variability)
    except fmpy.model_description.ValidationError as error:
        print(str(error).splitlines()[-1])
PYTHON
(cd "$folder" && venv/bin/python try.py 2>stderr) | tee "$folder/seen"
echo "pythonfmu 0.7.0, FMPy 0.3.32: the variability of an output that is an Integer, without one given and with discrete"
echo "guess: discrete, twice: the standard's own default, continuous, is for Reals only"
echo "seen:  the FMU without one is not valid"
printf -- '- The variable "n" (line 12) is of type Integer and must have variability != "continuous".\ndiscrete\n' |
    cmp - "$folder/seen"
