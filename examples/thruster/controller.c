/* Depth controller: thrust = kp (z - target) + kd v + ki ∫(z - target), shared by two thrusters.
 *
 * stepbus writes float64 numbers to descriptor 3 and reads the answers from descriptor 4 (format
 * raw). `stepbus types examples/thruster` prints the layout of each type. */
#include <stdio.h>
#include <stdlib.h>
#include <unistd.h>

enum { IN = 2 + 1 + 2, OUT = 2 + 1 }; /* step, t; present, depth, rate — thrust (2), mode */

static int get(double *numbers, size_t count) {
    char *to = (char *)numbers;
    size_t left = count * sizeof(double);
    while (left) {
        ssize_t n = read(3, to, left);
        if (n <= 0) return 0;
        to += n;
        left -= (size_t)n;
    }
    return 1;
}

static void put(const double *numbers, size_t count) {
    size_t size = count * sizeof(double);
    if (write(4, numbers, size) != (ssize_t)size) exit(1);
}

int main(void) {
    double ready = 1, header[8], param[4], in[IN], sum = 0;
    put(&ready, 1);
    if (!get(header, 8)) return 0; /* version, dt, every, first, n_in, n_out, seed, n_params */
    if (header[4] != IN || header[5] != OUT || header[7] != 4) {
        fprintf(stderr, "built for %d numbers in, %d out, 4 parameters; the scenario has %g, %g, %g\n",
                IN, OUT, header[4], header[5], header[7]);
        return 1;
    }
    get(param, 4); /* target, kp, kd, ki */
    while (get(in, IN)) {
        double error = in[3] - param[0], out[OUT] = {0, 0, 0}; /* mode 0: off */
        if (in[2] != 0) {
            sum += error * header[1];
            out[0] = out[1] = (param[1] * error + param[2] * in[4] + param[3] * sum) / 2;
            out[2] = 1; /* on */
        }
        put(out, OUT);
    }
    return 0;
}
