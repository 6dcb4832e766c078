/* SPDX-License-Identifier: GPL-3.0-or-later */
/* The volumes that four moving things span: `median_volumes` of addon/core/points/rigid_bodies/structure.py. */

#include <math.h>
#include <stddef.h>

#include "kernels.h"

#define LEAST 1e-36

/* Signed volumes (F,) with corners (3, F) each, in units of their sides. */
static void volumes_of(int64_t F, const double *a, const double *b, const double *c, const double *d,
                       double *restrict volumes) {
    const double *corner[4] = {a, b, c, d};
    for (int64_t f = 0; f < F; f++) {
        double away[3][3], sides = 1;
        for (int one = 0; one < 4; one++)
            for (int other = one + 1; other < 4; other++) {
                double square = 0;
                for (int x = 0; x < 3; x++) {
                    double along = corner[other][x * F + f] - corner[one][x * F + f];
                    if (one == 0) away[other - 1][x] = along;
                    square += along * along;
                }
                sides *= square;
            }
        double x = away[0][1] * away[1][2] - away[0][2] * away[1][1], y = away[0][2] * away[1][0] - away[0][0] * away[1][2];
        double z = away[0][0] * away[1][1] - away[0][1] * away[1][0];
        double volume = x * away[2][0] + y * away[2][1] + z * away[2][2];
        volumes[f] = volume / sqrt(sqrt(sides < LEAST ? LEAST : sides));
    }
}

/* The value of such a rank among values (N,), which are put in another order: all before it are no more than it is. */
static double ranked(double *values, int64_t count, int64_t rank) {
    for (int64_t low = 0, high = count - 1; low < high;) {
        double pivot = values[(low + high) / 2];
        int64_t i = low, j = high;
        while (i <= j) {
            while (values[i] < pivot) i++;
            while (values[j] > pivot) j--;
            if (i <= j) {
                double kept = values[i];
                values[i++] = values[j];
                values[j--] = kept;
            }
        }
        if (rank <= j)
            high = j;
        else if (rank >= i)
            low = i;
        else
            break;
    }
    return values[rank];
}

/* Of values (N,) that are not NaN, 0 where all are. */
static double median_of(double *values, int64_t count) {
    int64_t known = 0;
    for (int64_t i = 0; i < count; i++)
        if (isfinite(values[i])) values[known++] = values[i];
    if (known == 0) return 0;
    double upper = ranked(values, known, known / 2), lower = upper;
    if (known % 2 == 0) { /* the largest of those before */
        lower = values[0];
        for (int64_t i = 1; i < known / 2; i++) lower = fmax(lower, values[i]);
    }
    return (lower + upper) / 2;
}

/* Of Q quads (Q, 4) of things with places (G, 3, F): medians (Q,). `scratch` holds F numbers. */
KERNEL void median_volumes(int64_t count, int64_t frames, const double *place, const int64_t *quads, double *medians,
                           double *scratch) {
    for (int64_t q = 0; q < count; q++) {
        const int64_t *four = quads + 4 * q, step = 3 * frames;
        volumes_of(frames, place + four[0] * step, place + four[1] * step, place + four[2] * step,
                   place + four[3] * step, scratch);
        medians[q] = median_of(scratch, frames);
    }
}
