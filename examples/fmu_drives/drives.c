/* The drives of a two-link arm as an FMU (FMI 2.0, co-simulation): for each joint a motor, whose
   current follows its command with a lag and within a limit, a rotor with friction, and a gear
   that is elastic. Everything below is seen from the joint, behind the gear of ratio N:

       N² J dω/dt = N k i − friction(ω) − tau        the rotor
       dtwist/dt  = ω − velocity                     the gear; velocity: of the joint, an input
       tau        = stiffness twist + damping (ω − velocity)

   The gear must be elastic: a rotor rigid with the joint would be inertia of the arm, which only
   the plant's solver can take into account. */

#include <math.h>
#include <stdarg.h>
#include <stdio.h>
#include <string.h>

#include "fmi2Functions.h"

#define GUID "{6c1f7f0e-6f0b-4f0c-8d53-0f3e5a0c54b1}"
#define JOINTS 2
#define SUBSTEP 1e-4 /* s, at most */

/* Variables of one joint. The value reference of one is FIELDS × joint + field. */
enum {
    COMMAND,         /* N·m, input */
    VELOCITY,        /* rad/s, input */
    TAU,             /* N·m, output: on the joint */
    FRICTION_TORQUE, /* N·m, output: on the rotor */
    CURRENT,         /* A, output and state */
    TWIST,           /* rad, output and state: of the gear */
    SPEED,           /* rad/s, output and state: of the rotor, behind the gear */
    TORQUE_CONSTANT, /* N·m/A, k; this and the others that follow are parameters */
    LAG,             /* s: of the current */
    TORQUE_LIMIT,    /* N·m, behind the gear */
    INERTIA,         /* kg·m², J of the rotor, before the gear */
    RATIO,           /* 1, N */
    STIFFNESS,       /* N·m/rad */
    DAMPING,         /* N·m·s/rad */
    COULOMB,         /* N·m */
    VISCOUS,         /* N·m·s/rad */
    SMOOTH,          /* rad/s: speed at which 0.7 of the Coulomb friction is there */
    FIELDS
};
enum { FRICTION = JOINTS * FIELDS, COUNT }; /* the friction is multiplied by it; tunable */

static const double START[JOINTS][FIELDS] = {
    {[TORQUE_CONSTANT] = 0.1, [LAG] = 2e-3, [TORQUE_LIMIT] = 40, [INERTIA] = 1.5e-5, [RATIO] = 80,
     [STIFFNESS] = 3000, [DAMPING] = 5, [COULOMB] = 2, [VISCOUS] = 0.8, [SMOOTH] = 0.02},
    {[TORQUE_CONSTANT] = 0.08, [LAG] = 2e-3, [TORQUE_LIMIT] = 15, [INERTIA] = 1e-5, [RATIO] = 50,
     [STIFFNESS] = 1500, [DAMPING] = 2, [COULOMB] = 0.6, [VISCOUS] = 0.2, [SMOOTH] = 0.02},
};

/* All that a step depends on, without pointers: its bytes are the saved state. */
typedef struct {
    double values[COUNT];
    double time; /* s */
} State;

typedef struct {
    State state;
    int is_set_up; /* initialized: parameters that are not tunable are fixed from then on */
    fmi2CallbackFunctions call;
    char name[64];
} Drives;

static fmi2Status fail(Drives *drives, const char *format, ...) {
    char text[256];
    va_list arguments;
    va_start(arguments, format);
    vsnprintf(text, sizeof text, format, arguments);
    va_end(arguments);
    drives->call.logger(drives->call.componentEnvironment, drives->name, fmi2Error, "logStatusError",
                        "%s", text);
    return fmi2Error;
}

/* --- the physics ------------------------------------------------------------------------------ */

/* value / √(1 + value²) is like tanh, but the same to the last bit on all machines. */
static double smooth_sign(double value) { return value / sqrt(1 + value * value); }

static void outputs(double *v, double factor) {
    v[TAU] = v[STIFFNESS] * v[TWIST] + v[DAMPING] * (v[SPEED] - v[VELOCITY]);
    v[FRICTION_TORQUE] =
        factor * (v[COULOMB] * smooth_sign(v[SPEED] / v[SMOOTH]) + v[VISCOUS] * v[SPEED]);
}

static void advance(double *v, double factor, double h) {
    double torque_per_ampere = v[RATIO] * v[TORQUE_CONSTANT];
    double wanted = fmax(-v[TORQUE_LIMIT], fmin(v[COMMAND], v[TORQUE_LIMIT])) / torque_per_ampere;
    /* The current by the implicit Euler method, for lags that are shorter than a substep. */
    v[CURRENT] += h / (v[LAG] + h) * (wanted - v[CURRENT]);
    double torque = torque_per_ampere * v[CURRENT] - v[FRICTION_TORQUE] - v[TAU];
    v[SPEED] += h * torque / (v[RATIO] * v[RATIO] * v[INERTIA]);
    v[TWIST] += h * (v[SPEED] - v[VELOCITY]);
    outputs(v, factor);
}

/* --- FMI -------------------------------------------------------------------------------------- */

const char *fmi2GetTypesPlatform(void) { return fmi2TypesPlatform; }
const char *fmi2GetVersion(void) { return fmi2Version; }

fmi2Status fmi2SetDebugLogging(fmi2Component c, fmi2Boolean on, size_t n, const fmi2String names[]) {
    (void)c, (void)on, (void)n, (void)names; /* only errors are logged */
    return fmi2OK;
}

fmi2Status fmi2Reset(fmi2Component c) {
    Drives *drives = c;
    memset(&drives->state, 0, sizeof drives->state);
    memcpy(drives->state.values, START, sizeof START);
    drives->state.values[FRICTION] = 1;
    drives->is_set_up = 0;
    return fmi2OK;
}

fmi2Component fmi2Instantiate(fmi2String name, fmi2Type type, fmi2String guid, fmi2String resources,
                              const fmi2CallbackFunctions *call, fmi2Boolean visible,
                              fmi2Boolean logs) {
    (void)resources, (void)visible, (void)logs;
    Drives *drives = call->allocateMemory(1, sizeof *drives);
    if (!drives) return NULL;
    drives->call = *call;
    snprintf(drives->name, sizeof drives->name, "%s", name);
    if (type != fmi2CoSimulation || strcmp(guid, GUID) != 0) {
        fail(drives, "made for co-simulation with the GUID %s, not %s", GUID, guid);
        call->freeMemory(drives);
        return NULL;
    }
    fmi2Reset(drives);
    return drives;
}

void fmi2FreeInstance(fmi2Component c) {
    if (c) ((Drives *)c)->call.freeMemory(c);
}

fmi2Status fmi2SetupExperiment(fmi2Component c, fmi2Boolean has_tolerance, fmi2Real tolerance,
                               fmi2Real start, fmi2Boolean has_stop, fmi2Real stop) {
    (void)has_tolerance, (void)tolerance, (void)has_stop, (void)stop;
    ((Drives *)c)->state.time = start;
    return fmi2OK;
}

fmi2Status fmi2EnterInitializationMode(fmi2Component c) { return (void)c, fmi2OK; }

fmi2Status fmi2ExitInitializationMode(fmi2Component c) {
    static const int positive[] = {TORQUE_CONSTANT, LAG, TORQUE_LIMIT, INERTIA, RATIO, STIFFNESS, SMOOTH};
    Drives *drives = c;
    for (int joint = 0; joint < JOINTS; joint++) {
        double *v = drives->state.values + joint * FIELDS;
        for (size_t i = 0; i < sizeof positive / sizeof *positive; i++)
            if (!(v[positive[i]] > 0))
                return fail(drives, "drive %d: the parameter with the value %g must be positive",
                            joint + 1, v[positive[i]]);
        double slope = drives->state.values[FRICTION] * (v[COULOMB] / v[SMOOTH] + v[VISCOUS]);
        double change = SUBSTEP * (SUBSTEP * v[STIFFNESS] + v[DAMPING] + slope);
        if (!(change < v[RATIO] * v[RATIO] * v[INERTIA]))
            return fail(drives, "drive %d: its rotor is too light, or its gear too stiff, for substeps "
                        "of %g s", joint + 1, SUBSTEP);
        outputs(v, drives->state.values[FRICTION]);
    }
    drives->is_set_up = 1;
    return fmi2OK;
}

fmi2Status fmi2Terminate(fmi2Component c) { return (void)c, fmi2OK; }

fmi2Status fmi2GetReal(fmi2Component c, const fmi2ValueReference vr[], size_t n, fmi2Real value[]) {
    Drives *drives = c;
    for (size_t i = 0; i < n; i++) {
        if (vr[i] >= COUNT) return fail(drives, "there is no variable %u", vr[i]);
        value[i] = drives->state.values[vr[i]];
    }
    return fmi2OK;
}

fmi2Status fmi2SetReal(fmi2Component c, const fmi2ValueReference vr[], size_t n,
                       const fmi2Real value[]) {
    Drives *drives = c;
    for (size_t i = 0; i < n; i++) {
        unsigned field = vr[i] % FIELDS;
        int is_tunable = vr[i] == FRICTION || field <= VELOCITY;
        if (vr[i] >= COUNT || !(is_tunable || (field >= TORQUE_CONSTANT && !drives->is_set_up)))
            return fail(drives, "variable %u is not for setting now", vr[i]);
        if (!isfinite(value[i])) return fail(drives, "variable %u cannot be %g", vr[i], value[i]);
        drives->state.values[vr[i]] = value[i];
    }
    return fmi2OK;
}

fmi2Status fmi2DoStep(fmi2Component c, fmi2Real time, fmi2Real h, fmi2Boolean is_final) {
    (void)is_final; /* that no state before this step will be set: nothing hangs on it */
    Drives *drives = c;
    if (fabs(time - drives->state.time) > 1e-9 * fmax(1, fabs(time)) || !(h > 0))
        return fail(drives, "a step from %g s by %g s, but the time is %g s", time, h, drives->state.time);
    double count = ceil(h / SUBSTEP - 1e-6);
    double *values = drives->state.values;
    for (int joint = 0; joint < JOINTS; joint++)
        for (double i = 0; i < count; i++)
            advance(values + joint * FIELDS, values[FRICTION], h / count);
    drives->state.time = time + h;
    for (int joint = 0; joint < JOINTS; joint++)
        if (!isfinite(values[joint * FIELDS + TAU]))
            return fail(drives, "drive %d: its torque is no number any more", joint + 1);
    return fmi2OK;
}

/* --- its state: the bytes of `State` ---------------------------------------------------------- */

fmi2Status fmi2GetFMUstate(fmi2Component c, fmi2FMUstate *saved) {
    Drives *drives = c;
    if (!*saved) *saved = drives->call.allocateMemory(1, sizeof(State));
    if (!*saved) return fail(drives, "no memory for its state");
    memcpy(*saved, &drives->state, sizeof(State));
    return fmi2OK;
}

fmi2Status fmi2SetFMUstate(fmi2Component c, fmi2FMUstate saved) {
    Drives *drives = c;
    memcpy(&drives->state, saved, sizeof(State));
    drives->is_set_up = 1;
    return fmi2OK;
}

fmi2Status fmi2FreeFMUstate(fmi2Component c, fmi2FMUstate *saved) {
    if (*saved) ((Drives *)c)->call.freeMemory(*saved);
    *saved = NULL;
    return fmi2OK;
}

fmi2Status fmi2SerializedFMUstateSize(fmi2Component c, fmi2FMUstate saved, size_t *size) {
    (void)c, (void)saved;
    *size = sizeof(State);
    return fmi2OK;
}

fmi2Status fmi2SerializeFMUstate(fmi2Component c, fmi2FMUstate saved, fmi2Byte bytes[], size_t size) {
    if (size < sizeof(State)) return fail(c, "its state has %zu bytes, not %zu", sizeof(State), size);
    memcpy(bytes, saved, sizeof(State));
    return fmi2OK;
}

fmi2Status fmi2DeSerializeFMUstate(fmi2Component c, const fmi2Byte bytes[], size_t size,
                                   fmi2FMUstate *saved) {
    if (size != sizeof(State)) return fail(c, "its state has %zu bytes, not %zu", sizeof(State), size);
    *saved = NULL;
    fmi2Status status = fmi2GetFMUstate(c, saved);
    if (status == fmi2OK) memcpy(*saved, bytes, sizeof(State));
    return status;
}

/* --- what the standard has and this FMU has not ----------------------------------------------- */

static fmi2Status none(fmi2Component c, const char *what, size_t n) {
    return n ? fail(c, "it has no %s", what) : fmi2OK;
}

#define NO_VARIABLES(type)                                                                           \
    fmi2Status fmi2Get##type(fmi2Component c, const fmi2ValueReference vr[], size_t n,               \
                             fmi2##type value[]) {                                                   \
        return (void)vr, (void)value, none(c, #type " variables", n);                                \
    }                                                                                                \
    fmi2Status fmi2Set##type(fmi2Component c, const fmi2ValueReference vr[], size_t n,               \
                             const fmi2##type value[]) {                                             \
        return (void)vr, (void)value, none(c, #type " variables", n);                                \
    }
NO_VARIABLES(Integer)
NO_VARIABLES(Boolean)
NO_VARIABLES(String)

#define NO_STATUS(name, type)                                                                        \
    fmi2Status fmi2Get##name(fmi2Component c, const fmi2StatusKind kind, type *value) {              \
        return (void)c, (void)kind, (void)value, fmi2Discard;                                        \
    }
NO_STATUS(Status, fmi2Status)
NO_STATUS(RealStatus, fmi2Real)
NO_STATUS(IntegerStatus, fmi2Integer)
NO_STATUS(BooleanStatus, fmi2Boolean)
NO_STATUS(StringStatus, fmi2String)

fmi2Status fmi2CancelStep(fmi2Component c) { return none(c, "steps to cancel", 1); }

fmi2Status fmi2GetDirectionalDerivative(fmi2Component c, const fmi2ValueReference unknown[], size_t n,
                                        const fmi2ValueReference known[], size_t m,
                                        const fmi2Real seed[], fmi2Real value[]) {
    return (void)unknown, (void)known, (void)m, (void)seed, (void)value, none(c, "derivatives", n);
}

fmi2Status fmi2SetRealInputDerivatives(fmi2Component c, const fmi2ValueReference vr[], size_t n,
                                       const fmi2Integer order[], const fmi2Real value[]) {
    return (void)vr, (void)order, (void)value, none(c, "derivatives of inputs", n);
}

fmi2Status fmi2GetRealOutputDerivatives(fmi2Component c, const fmi2ValueReference vr[], size_t n,
                                        const fmi2Integer order[], fmi2Real value[]) {
    return (void)vr, (void)order, (void)value, none(c, "derivatives of outputs", n);
}
