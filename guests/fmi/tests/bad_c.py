"""FMUs in C that do one thing at one place: y counts the steps, k is a parameter, u an input."""

import fmus

_COMMON = """
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>
static double values[3];
static int steps;
static char where_[16], what[16], trace[256];
static void prepare(const char *resources) {
    char path[512];
    snprintf(path, sizeof path, "%s/bad.txt", resources);
    FILE *f = fopen(path, "r");
    fscanf(f, "%15s %15s %255s", where_, what, trace);
    fclose(f);
}
static int is(const char *word) { return strcmp(what, word) == 0; }
static int at(const char *where) {
    FILE *f = fopen(trace, "a");
    if (f) { fprintf(f, "%s ", where); fclose(f); }
    if (strcmp(where, where_) || (strcmp(where, "doStep") == 0 && ++steps < 4)) return 0;
    const char *states[] = {"ok", "warning", "discard", "error", "fatal"};
    for (int s = 0; s < 5; ++s) if (is(states[s])) { say(s, "it boils over"); return s; }
    if (is("segv")) raise(SIGSEGV);
    if (is("abort")) abort();
    if (is("exit")) exit(3);
    if (is("hang")) for (;;) ;
    if (is("chatter")) for (;;) say(1, "and another thing");
    if (is("print")) for (int n = 0; n < 2000; ++n) { puts("a line of text"); fputs("more ", stderr); }
    if (is("chdir")) chdir("/");
    if (is("signals")) for (int n = 1; n < 32; ++n) signal(n, SIG_IGN);
    return 0;
}
"""
_C3 = """
#include "fmi3Functions.h"
static fmi3LogMessageCallback note;
static void *environment;
static void say(int s, const char *t) { note(environment, s, "test", t); }
#COMMON
fmi3Instance fmi3InstantiateCoSimulation(fmi3String n, fmi3String token, fmi3String path,
    fmi3Boolean visible, fmi3Boolean logs, fmi3Boolean events, fmi3Boolean early,
    const fmi3ValueReference *v, size_t nv, void *e, fmi3LogMessageCallback log,
    fmi3IntermediateUpdateCallback update) {
    note = log; environment = e; prepare(path);
    if (at("instantiate") || strcmp(token, "g")) { say(3, "the token is wrong"); return 0; }
    return values;
}
void fmi3FreeInstance(fmi3Instance i) { at("free"); }
fmi3Status fmi3EnterInitializationMode(fmi3Instance i, fmi3Boolean d, fmi3Float64 t, fmi3Float64 s,
    fmi3Boolean e, fmi3Float64 st) { return at("enter"); }
fmi3Status fmi3ExitInitializationMode(fmi3Instance i) { return at("exit"); }
fmi3Status fmi3Terminate(fmi3Instance i) { return at("terminate"); }
fmi3Status fmi3SetFloat64(fmi3Instance i, const fmi3ValueReference *v, size_t n,
    const fmi3Float64 *x, size_t nx) {
    for (size_t k = 0; k < n; ++k) values[v[k]] = x[k];
    return at("set");
}
fmi3Status fmi3GetFloat64(fmi3Instance i, const fmi3ValueReference *v, size_t n, fmi3Float64 *x,
    size_t nx) {
    for (size_t k = 0; k < n; ++k) x[k] = values[v[k]];
    return at("get");
}
fmi3Status fmi3DoStep(fmi3Instance i, fmi3Float64 t, fmi3Float64 h, fmi3Boolean no,
    fmi3Boolean *event, fmi3Boolean *end, fmi3Boolean *early, fmi3Float64 *last) {
    *event = *end = *early = 0;
    *last = t + h;
    values[2] += 1;
    return at("doStep");
}
"""
_C2 = """
#include "fmi2Functions.h"
static const fmi2CallbackFunctions *calls;
static void say(int s, const char *t) {
    calls->logger(calls->componentEnvironment, "m", s, "test", "%s", t);
}
#COMMON
fmi2Component fmi2Instantiate(fmi2String n, fmi2Type t, fmi2String guid, fmi2String path,
    const fmi2CallbackFunctions *c, fmi2Boolean visible, fmi2Boolean logs) {
    calls = c;
    prepare(path + strlen("file://"));
    if (at("instantiate") || strcmp(guid, "g")) { say(3, "the token is wrong"); return 0; }
    return values;
}
void fmi2FreeInstance(fmi2Component i) { at("free"); }
fmi2Status fmi2SetupExperiment(fmi2Component i, fmi2Boolean d, fmi2Real t, fmi2Real s,
    fmi2Boolean e, fmi2Real st) { return at("setup"); }
fmi2Status fmi2EnterInitializationMode(fmi2Component i) { return at("enter"); }
fmi2Status fmi2ExitInitializationMode(fmi2Component i) { return at("exit"); }
fmi2Status fmi2Terminate(fmi2Component i) { return at("terminate"); }
fmi2Status fmi2SetReal(fmi2Component i, const fmi2ValueReference *v, size_t n, const fmi2Real *x) {
    for (size_t k = 0; k < n; ++k) values[v[k]] = x[k];
    return at("set");
}
fmi2Status fmi2GetReal(fmi2Component i, const fmi2ValueReference *v, size_t n, fmi2Real *x) {
    for (size_t k = 0; k < n; ++k) x[k] = values[v[k]];
    return at("get");
}
fmi2Status fmi2DoStep(fmi2Component i, fmi2Real t, fmi2Real h, fmi2Boolean no) {
    values[2] += 1;
    return at("doStep");
}
"""
ROWS = {
    2: [
        'name="u" valueReference="0" causality="input" variability="continuous"><Real start="0"/>',
        'name="k" valueReference="1" causality="parameter" variability="fixed"><Real start="0"/>',
        'name="y" valueReference="2" causality="output" variability="continuous"><Real/>',
    ],
    3: [
        '<Float64 name="u" valueReference="0" causality="input" start="0"/>',
        '<Float64 name="k" valueReference="1" causality="parameter" variability="fixed" start="0"/>',
        '<Float64 name="y" valueReference="2" causality="output"/>',
    ],
}


def bad(folder, at="", do="", major=3, can="", missing=(), xml=None):
    """Return an FMU that does something in a call, or in its fourth `doStep`; see `at` above.

    It writes the name of each call to the file `calls` beside it.
    """
    source = (_C2 if major == 2 else _C3).replace("#COMMON", _COMMON)
    write = fmus.xml2 if major == 2 else fmus.xml3
    text = f"{at or '-'} {do or '-'} {folder / 'calls'}"
    xml = xml or write(ROWS[major], can)
    return fmus.build_c(folder, source, xml, missing, {"resources/bad.txt": text})
