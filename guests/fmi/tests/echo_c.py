"""FMUs in C that give back in the next step what they get; defines switch more on."""

import fmus

_3 = """
#include "fmi3Functions.h"
#include <math.h>
#include <stdlib.h>
#include <string.h>
static double now;
static unsigned events, is_event, is_discrete;
#define ARGUMENTS fmi3Instance i, const fmi3ValueReference *v, size_t n
#define KIND(T) static fmi3##T T##_[64]; \\
    fmi3Status fmi3Set##T(ARGUMENTS, const fmi3##T *x, size_t nx) { SET(T) return 0; } \\
    fmi3Status fmi3Get##T(ARGUMENTS, fmi3##T *x, size_t nx) { GET(T) return 0; }
#define SET(T) for (size_t k = 0; k < n; ++k) T##_[v[k]] = x[k];
#define GET(T) for (size_t k = 0; k < n; ++k) x[k] = T##_[v[k]];
KIND(Float32) KIND(Int8) KIND(UInt8) KIND(Int16) KIND(UInt16) KIND(UInt32) KIND(Int64)
KIND(UInt64) KIND(Boolean)
/* an array of UInt64_[30] values begins at 40, and at 50 */
#undef SET
#undef GET
#define SET(T) while (n--) { size_t c = *v >= 40 ? UInt64_[30] : 1; \\
    memcpy(T##_ + *v++, x, c * sizeof *x); x += c; }
#define GET(T) while (n--) { size_t c = *v >= 40 ? UInt64_[30] : 1; \\
    memcpy(x, T##_ + *v++, c * sizeof *x); x += c; }
KIND(Float64)
#undef SET
#undef GET
/* a discrete input: only set before the first step, and in event mode */
#define SET(T) if (is_discrete && !is_event) return 3; Int32_[*v] = *x;
#define GET(T) for (size_t k = 0; k < n; ++k) x[k] = v[k] == 21 ? events : Int32_[v[k]];
KIND(Int32)
static char texts[64][32];
static unsigned char blobs[64][32];
static size_t sizes[64];
fmi3Status fmi3SetString(ARGUMENTS, const fmi3String *x, size_t nx) {
    for (size_t k = 0; k < n; ++k) strcpy(texts[v[k]], x[k]);
    return 0;
}
fmi3Status fmi3GetString(ARGUMENTS, fmi3String *x, size_t nx) {
    for (size_t k = 0; k < n; ++k) x[k] = texts[v[k]];
    return 0;
}
fmi3Status fmi3SetBinary(ARGUMENTS, const size_t *s, const fmi3Binary *x, size_t nx) {
    for (size_t k = 0; k < n; ++k) memcpy(blobs[v[k]], x[k], sizes[v[k]] = s[k]);
    return 0;
}
fmi3Status fmi3GetBinary(ARGUMENTS, size_t *s, fmi3Binary *x, size_t nx) {
    for (size_t k = 0; k < n; ++k) { x[k] = blobs[v[k]]; s[k] = sizes[v[k]]; }
    return 0;
}
fmi3Instance fmi3InstantiateCoSimulation(fmi3String n, fmi3String token, fmi3String path,
    fmi3Boolean visible, fmi3Boolean logs, fmi3Boolean uses_events, fmi3Boolean early,
    const fmi3ValueReference *v, size_t nv, void *e, fmi3LogMessageCallback log,
    fmi3IntermediateUpdateCallback update) {
    UInt64_[30] = 2;
    Float64_[35] = 1;
    is_event = uses_events;
    return &now;
}
void fmi3FreeInstance(fmi3Instance i) {}
fmi3Status fmi3EnterConfigurationMode(fmi3Instance i) { return 0; }
fmi3Status fmi3ExitConfigurationMode(fmi3Instance i) { return 0; }
fmi3Status fmi3EnterInitializationMode(fmi3Instance i, fmi3Boolean d, fmi3Float64 t,
    fmi3Float64 begin, fmi3Boolean e, fmi3Float64 s) { now = begin; return 0; }
fmi3Status fmi3ExitInitializationMode(fmi3Instance i) { is_discrete = is_event; return 0; }
fmi3Status fmi3Terminate(fmi3Instance i) { return 0; }
fmi3Status fmi3EnterEventMode(fmi3Instance i) { return is_event++ ? 3 : 0; }
fmi3Status fmi3EnterStepMode(fmi3Instance i) { return is_event-- ? 0 : 3; }
fmi3Status fmi3UpdateDiscreteStates(fmi3Instance i, fmi3Boolean *more, fmi3Boolean *end,
    fmi3Boolean *nominals, fmi3Boolean *values, fmi3Boolean *is_next, fmi3Float64 *next) {
    *more = *end = *nominals = *values = *is_next = 0;
    *more = ++events % 2;
    return is_event ? 0 : 3;
}
fmi3Status fmi3DoStep(fmi3Instance i, fmi3Float64 t, fmi3Float64 h, fmi3Boolean no,
    fmi3Boolean *event, fmi3Boolean *end, fmi3Boolean *early, fmi3Float64 *last) {
    if (fabs(t - now) > 1e-9 || is_event) return 3;
    *event = *end = *early = 0;
#ifdef EARLY
    if (h > 0.0065) { h = 0.004; *early = *event = 1; }
#endif
#ifdef ENDS
    *end = t > 0.045;
#endif
    *last = now = t + h;
#define ECHO(T, k) T##_[k + 1] = T##_[k];
    ECHO(Float64, 0) ECHO(Float32, 2) ECHO(Int8, 4) ECHO(UInt8, 6) ECHO(Int16, 8) ECHO(UInt16, 10)
    ECHO(Int32, 12) ECHO(UInt32, 14) ECHO(Int64, 16) ECHO(UInt64, 18) ECHO(Boolean, 24)
    ECHO(Int64, 32)
    strcpy(texts[27], texts[26]);
    memcpy(blobs[29], blobs[28], sizes[29] = sizes[28]);
    for (int k = 0; k < UInt64_[30]; ++k) Float64_[50 + k] = 2 * Float64_[40 + k];
    Float64_[36] += Float64_[35] * h;
    return 0;
}
typedef struct { double now, values[64]; double *where; } State;
static double elsewhere;
fmi3Status fmi3GetFMUState(fmi3Instance i, fmi3FMUState *s) {
    State *state = *s = malloc(sizeof(State));
    state->now = now; state->where = &elsewhere;
    memcpy(state->values, Float64_, sizeof Float64_);
    return 0;
}
fmi3Status fmi3FreeFMUState(fmi3Instance i, fmi3FMUState *s) { free(*s); *s = 0; return 0; }
fmi3Status fmi3SetFMUState(fmi3Instance i, fmi3FMUState s) {
    State *state = s;
    now = state->now;
    memcpy(Float64_, state->values, sizeof Float64_);
#ifdef POINTERS
    if (state->where != &elsewhere) abort();
#endif
#ifdef FORGETS
    Float64_[36] = 0;
#endif
    return 0;
}
fmi3Status fmi3SerializedFMUStateSize(fmi3Instance i, fmi3FMUState s, size_t *n) {
    *n = sizeof(State);
    return 0;
}
fmi3Status fmi3SerializeFMUState(fmi3Instance i, fmi3FMUState s, fmi3Byte *b, size_t n) {
    memcpy(b, s, n);
    return 0;
}
fmi3Status fmi3DeserializeFMUState(fmi3Instance i, const fmi3Byte *b, size_t n, fmi3FMUState *s) {
    memcpy(*s = malloc(n), b, n);
    return 0;
}
"""
_2 = """
#include "fmi2Functions.h"
static double values[8], slope;
static int numbers[8];
fmi2Component fmi2Instantiate(fmi2String n, fmi2Type t, fmi2String guid, fmi2String path,
    const fmi2CallbackFunctions *c, fmi2Boolean visible, fmi2Boolean logs) { return values; }
void fmi2FreeInstance(fmi2Component i) {}
fmi2Status fmi2SetupExperiment(fmi2Component i, fmi2Boolean d, fmi2Real t, fmi2Real s,
    fmi2Boolean e, fmi2Real st) { return 0; }
fmi2Status fmi2EnterInitializationMode(fmi2Component i) { return 0; }
fmi2Status fmi2ExitInitializationMode(fmi2Component i) { return 0; }
fmi2Status fmi2Terminate(fmi2Component i) { return 0; }
fmi2Status fmi2SetReal(fmi2Component i, const fmi2ValueReference *v, size_t n, const fmi2Real *x) {
    while (n--) values[*v++] = *x++;
    return 0;
}
fmi2Status fmi2GetReal(fmi2Component i, const fmi2ValueReference *v, size_t n, fmi2Real *x) {
    while (n--) *x++ = values[*v++];
    return 0;
}
fmi2Status fmi2SetInteger(fmi2Component i, const fmi2ValueReference *v, size_t n,
    const fmi2Integer *x) { while (n--) numbers[*v++] = *x++; return 0; }
fmi2Status fmi2GetInteger(fmi2Component i, const fmi2ValueReference *v, size_t n, fmi2Integer *x) {
    while (n--) *x++ = numbers[*v++];
    return 0;
}
fmi2Status fmi2SetRealInputDerivatives(fmi2Component i, const fmi2ValueReference *v, size_t n,
    const fmi2Integer *order, const fmi2Real *x) { slope = *x; return 0; }
fmi2Status fmi2DoStep(fmi2Component i, fmi2Real t, fmi2Real h, fmi2Boolean no) {
#ifdef ENDS
    if (t > 0.045) return 2;
#endif
    values[1] = values[0] + slope * h;
    numbers[3] = numbers[2];
    return 0;
}
fmi2Status fmi2GetBooleanStatus(fmi2Component i, const fmi2StatusKind k, fmi2Boolean *x) {
    *x = k == fmi2Terminated;
    return 0;
}
"""
_TYPES = ["Float64", "Float32", "Int8", "UInt8", "Int16", "UInt16", "Int32", "UInt32", "Int64",
          "UInt64"]  # fmt: skip
UNITS = (
    '<UnitDefinitions><Unit name="m"><BaseUnit m="1"/></Unit><Unit name="degC">'
    '<BaseUnit K="1" offset="273.15"/></Unit><Unit name="mm"><BaseUnit m="1" factor="0.001"/>'
    "</Unit></UnitDefinitions>"
)
COLOURS = (
    '<TypeDefinitions><EnumerationType name="Colour"><Item name="red" value="1"/>'
    '<Item name="blue" value="4"/></EnumerationType></TypeDefinitions>'
)


def _row(kind, name, number, causality, more="", inside=""):
    start = 'start="0"' if causality != "output" and "start" not in more + inside else ""
    end = f">{inside}</{kind}>" if inside else "/>"
    return f'<{kind} name="{name}" valueReference="{number}" causality="{causality}" {start} {more}{end}'


def _pair(kind, name, number, more="", inside=""):
    other = "" if inside.startswith("<Start") else inside
    kept = more.replace('start="false"', "").replace('start="0 0"', "")
    return [
        _row(kind, name, number, "input", more, inside),
        _row(kind, f"{name}_out", number + 1 if number < 40 else 50, "output", kept, other),
    ]


ROWS = [
    *_pair("Float64", "x", 0, 'unit="m"'),
    *(row for n, kind in enumerate(_TYPES[1:], 1) for row in _pair(kind, kind.lower(), 2 * n)),
    *_pair("Boolean", "flag", 24, 'start="false"'),
    *_pair("String", "text", 26, inside='<Start value="hello"/>'),
    *_pair("Binary", "data", 28, 'mimeType="application/x"', '<Start value="00ff"/>'),
    *_pair("Enumeration", "colour", 32, 'declaredType="Colour"'),
    _row("UInt64", "size", 30, "structuralParameter", 'variability="fixed" start="2"'),
    *_pair("Float64", "a", 40, 'start="0 0"', '<Dimension valueReference="30"/>'),
    _row("Float64", "rate", 35, "parameter", 'variability="tunable" start="1" unit="mm"'),
    _row("Float64", "sum", 36, "output"),
    _row("Int32", "events", 21, "output"),
    _row("Float64", "inner", 37, "local"),
]


def echo(folder, *defines, can="", name="echo"):
    """Return an FMU for FMI 3.0 with inputs of each type, and outputs `NAME_out` that follow."""
    head = "".join(f"#define {word}\n" for word in defines)
    xml = fmus.xml3(ROWS, can, name, units=UNITS, types=COLOURS)
    return fmus.build_c(folder, head + _3, xml)


def echo_2(folder, *defines, can="", name="echo"):
    """Return an FMU for FMI 2.0 that gives back a real and an enumeration."""
    head = "".join(f"#define {word}\n" for word in defines)
    discrete = 'variability="discrete"><Enumeration declaredType="Colour"'
    rows = [
        'name="x" valueReference="0" causality="input"><Real start="0" unit="m"/>',
        'name="x_out" valueReference="1" causality="output" variability="continuous"><Real/>',
        f'name="colour" valueReference="2" causality="input" {discrete} start="1"/>',
        f'name="colour_out" valueReference="3" causality="output" {discrete}/>',
    ]
    types = (
        '<TypeDefinitions><SimpleType name="Colour"><Enumeration><Item name="red" value="1"/>'
        '<Item name="blue" value="4"/></Enumeration></SimpleType></TypeDefinitions>'
    )
    return fmus.build_c(folder, head + _2, fmus.xml2(rows, can, name, units=UNITS, types=types))
