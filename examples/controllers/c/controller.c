/* PD controller of a two-link arm: tau = kp (q_d - q) + kd (v_d - v), cut at the joints' limits.
 *
 * stepbus starts this program, writes MessagePack maps to descriptor 3, each behind its length, and
 * reads the answers from descriptor 4. What it prints goes to logs/controller.log. */
#include <math.h>

#include "bridge.h"

enum { JOINTS = 16 };
static double kp, kd, limit[JOINTS];
static int joints, at_reference[JOINTS]; /* index of each joint in reference */

static double required(value map, const char *key) {
    value v = mp_get(map, key);
    if (!v) fail(key);
    return mp_number(v);
}

static void start(value inputs) {
    value names = mp_get(mp_get(inputs, "joint_state"), "names");
    value others = mp_get(mp_get(inputs, "reference"), "names");
    value limits = mp_get(mp_get(mp_get(inputs, "joint_state"), "limits"), "effort");
    if (!names || !others || mp_size(names) > JOINTS) fail("1 to 16 joints are needed");
    joints = (int)mp_size(names);
    for (int i = 0; i < joints; i++) {
        value name = mp_at(names, i);
        size_t length = (size_t)(mp_next(name) - name), k = 0, n = mp_size(others);
        while (k < n && memcmp(mp_at(others, k), name, length)) k++;
        if (k == n) fail("the reference lacks a joint of joint_state");
        at_reference[i] = (int)k;
        limit[i] = limits ? mp_number(mp_at(limits, i)) : INFINITY;
    }
}

static void update(value inputs) {
    value state = mp_get(inputs, "joint_state"), reference = mp_get(inputs, "reference");
    value q = mp_get(state, "position"), v = mp_get(state, "velocity");
    value qd = mp_get(reference, "position"), vd = mp_get(reference, "velocity");
    if (!q || !v || !qd || !vd) { /* an input has no message yet */
        answer(mp_map(out + 4, 0));
        return;
    }
    double torque[JOINTS];
    for (int i = 0; i < joints; i++) {
        double error = mp_number(mp_at(qd, at_reference[i])) - mp_number(mp_at(q, i));
        double rate = mp_number(mp_at(vd, at_reference[i])) - mp_number(mp_at(v, i));
        torque[i] = fmin(fmax(kp * error + kd * rate, -limit[i]), limit[i]);
    }
    unsigned char *to = mp_map(mp_text(mp_map(out + 4, 1), "outputs"), 1);
    to = mp_text(mp_text(mp_map(mp_text(to, "command"), 2), "mode"), "torque");
    answer(mp_numbers(mp_text(to, "values"), torque, joints));
}

int main(void) {
    for (value got = next_message(), message; got; got = next_message()) {
        if ((message = mp_get(got, "welcome"))) {
            kp = required(mp_get(message, "params"), "kp");
            kd = required(mp_get(message, "params"), "kd");
            /* Load your model here: the run starts when the program is ready. */
            answer(mp_map(mp_text(mp_map(out + 4, 1), "ready"), 0));
        } else if ((message = mp_get(got, "start"))) {
            start(mp_get(message, "inputs"));
        } else if ((message = mp_get(got, "update"))) {
            update(mp_get(message, "inputs"));
        }
    }
    return 0;
}
