/* Baseline of benchmarks/speed: squared error of many two-RC circuits on one record.
 * Candidates are SIMD lanes: every inner loop runs over a block of LANES of them. */
#include <stddef.h>

#define LANES 16

/* rows of `circuit`, each `candidates` long: decay1, push1, decay2, push2, r0 */
void squared_errors(const double *restrict circuit, size_t candidates,
                    const double *restrict current, const double *restrict base,
                    size_t samples, double *restrict total)
{
    for (size_t block = 0; block < candidates; block += LANES) {
        double decay1[LANES], push1[LANES], decay2[LANES], push2[LANES], r0[LANES];
        double state1[LANES] = {0}, state2[LANES] = {0}, sum[LANES] = {0};
        for (size_t lane = 0; lane < LANES; lane++) {
            const double *own = circuit + block + lane;
            decay1[lane] = own[0];
            push1[lane] = own[candidates];
            decay2[lane] = own[2 * candidates];
            push2[lane] = own[3 * candidates];
            r0[lane] = own[4 * candidates];
        }
        for (size_t k = 0; k < samples; k++) {
            const double i = current[k], e = base[k];
            for (size_t lane = 0; lane < LANES; lane++) {
                const double error = e + r0[lane] * i + state1[lane] + state2[lane];
                sum[lane] += error * error;
                state1[lane] = decay1[lane] * state1[lane] + push1[lane] * i;
                state2[lane] = decay2[lane] * state2[lane] + push2[lane] * i;
            }
        }
        for (size_t lane = 0; lane < LANES; lane++)
            total[block + lane] = sum[lane];
    }
}
