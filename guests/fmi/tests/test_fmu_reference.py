"""FMUs in stepbus do what they do in FMPy: coupled, branched, and over many steps."""

from pathlib import Path

import fmus
import pytest
import reference

SPRING = """
class Spring(Fmi2Slave):
    def __init__(self, **options):
        super().__init__(**options)
        self.x = 0.0
        self.force = -1.0
        self.register_variable(Real("x", causality=Fmi2Causality.input, start=0.0))
        self.register_variable(Real("force", causality=Fmi2Causality.output))

    def do_step(self, time, h):
        self.force = -40.0 * self.x - 0.3 * self.force
        return True
"""
MASS = """
#include <string.h>
#include "fmi2Functions.h"
static double s[3] = {0.1, 0, 0};  // position, velocity, force
fmi2Component fmi2Instantiate(fmi2String n, fmi2Type t, fmi2String g, fmi2String r,
    const fmi2CallbackFunctions *f, fmi2Boolean v, fmi2Boolean l) { return s; }
void fmi2FreeInstance(fmi2Component c) {}
#define OK { return fmi2OK; }
fmi2Status fmi2SetupExperiment(fmi2Component c, fmi2Boolean d, fmi2Real t, fmi2Real s,
    fmi2Boolean e, fmi2Real o) OK
fmi2Status fmi2EnterInitializationMode(fmi2Component c) OK
fmi2Status fmi2ExitInitializationMode(fmi2Component c) OK
fmi2Status fmi2Terminate(fmi2Component c) OK
#define EACH(a, b) { for (size_t k = 0; k < n; ++k) a = b; return fmi2OK; }
fmi2Status fmi2GetReal(fmi2Component c, const fmi2ValueReference r[], size_t n, fmi2Real v[])
    EACH(v[k], s[r[k]])
fmi2Status fmi2SetReal(fmi2Component c, const fmi2ValueReference r[], size_t n,
    const fmi2Real v[]) EACH(s[r[k]], v[k])
fmi2Status fmi2DoStep(fmi2Component c, fmi2Real t, fmi2Real h, fmi2Boolean no) {
    s[1] += h * (s[2] / 0.7 - 0.1 * s[1]); s[0] += h * s[1]; return fmi2OK;
}
fmi2Status fmi2GetFMUstate(fmi2Component c, fmi2FMUstate *f) { *f = s; return fmi2OK; }
fmi2Status fmi2SetFMUstate(fmi2Component c, fmi2FMUstate f) { if (f != s) memcpy(s, f, sizeof s);
    return fmi2OK; }
fmi2Status fmi2FreeFMUstate(fmi2Component c, fmi2FMUstate *f) OK
fmi2Status fmi2SerializedFMUstateSize(fmi2Component c, fmi2FMUstate f, size_t *n)
    { *n = sizeof s; return fmi2OK; }
fmi2Status fmi2SerializeFMUstate(fmi2Component c, fmi2FMUstate f, fmi2Byte b[], size_t n)
    { memcpy(b, s, n); return fmi2OK; }
fmi2Status fmi2DeSerializeFMUstate(fmi2Component c, const fmi2Byte b[], size_t n, fmi2FMUstate *f)
    { static double kept[3]; memcpy(kept, b, n); *f = kept; return fmi2OK; }
"""


def mass(folder: Path) -> Path:
    variables = [
        f'name="{name}" valueReference="{n}" causality="{causality}"><Real{start}/>'
        for n, name, causality, start in (
            (0, "x", "output", ""),
            (1, "v", "output", ""),
            (2, "force", "input", ' start="0"'),
        )
    ]
    can = " ".join(f'{flag}="true"' for flag in (
        "canGetAndSetFMUstate", "canSerializeFMUstate", "canHandleVariableCommunicationStepSize",
    ))  # fmt: skip
    return fmus.build_c(folder, MASS, fmus.xml2(variables, can, name="mass"))


def test_a_coupled_pair_does_to_the_bit_what_a_loop_over_fmpy_does(tmp_path):
    ends = (
        reference.End(fmus.build(tmp_path, SPRING), "x", "force"),
        reference.End(mass(tmp_path), "force", "x"),
    )
    same, text = reference.apart(reference.coupled, ends, 300, 0.01)
    assert same, text


def test_branches_from_saved_states_go_on_to_the_byte(tmp_path):
    result = reference.run(mass(tmp_path), 0.01, 60, None, tmp_path)
    assert reference.branches(tmp_path / "run", result.steps) == "20 exact"


@pytest.mark.slow
def test_many_steps_take_no_more_memory(tmp_path):
    ok, text = reference.apart(reference.memory, mass(tmp_path), 200_000)
    assert ok, text
