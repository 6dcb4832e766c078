/* SPDX-License-Identifier: GPL-3.0-or-later */
/* How likely points are markers by their distances to named ones: `of_frames` and `of_ends` of
 * addon/core/points/whole_take/likeness.py, and `distance_sums` of its pairs.py. */

#include <math.h>
#include <stddef.h>
#include <string.h>

#include "kernels.h"
#include "small.h"

/* What one point is to the M markers of its frame: how far it is from each, m, NaN where that is not there, and the
 * products (M, 6) of its direction from it with itself, as `spread` in `odds_of_marker` has them. */
typedef struct {
    double *distance, *products;
} Seen;

static void look(int64_t M, const float *point, const float *placed, const Seen *seen) {
    for (int64_t m = 0; m < M; m++) {
        const float *there = placed + 3 * m;
        double x = (double)point[0] - there[0], y = (double)point[1] - there[1], z = (double)point[2] - there[2];
        double square = x * x + y * y + z * z, share = 1 / square, *product = seen->products + 6 * m;
        seen->distance[m] = isfinite(square) ? sqrt(square) : NAN;
        product[0] = share * x * x, product[1] = share * y * y, product[2] = share * z * z;
        product[3] = share * x * y, product[4] = share * x * z, product[5] = share * y * z;
    }
}

/* Log odds that a point is a marker whose Q neighbours are `near`, at distances of such mean and precision (1 / variance;
 * 0 where one is not known), where the point is `seen` from all others but `own`. */
static double odds_of_marker(const Likeness *how, const int64_t *near, const double *mean, const double *precision,
                             int64_t own, const Seen *seen) {
    double square = 0, spread[6] = {0}, wide = 1 / (how->wide * how->wide);
    int64_t asked = 0;
    for (int64_t q = 0; q < how->near_count && asked < how->neighbours; q++) {
        double distance = seen->distance[near[q]], weight = precision[q];
        if (near[q] == own || isnan(distance) || weight == 0) continue;
        asked++;
        const double *product = seen->products + 6 * near[q];
        double off = (distance - mean[q]) * (distance - mean[q]) * weight;
        square += off < how->max_square ? off : how->max_square;
        for (int i = 0; i < 6; i++) spread[i] += weight * product[i];
    }
    if (asked < how->min_neighbours) return NAN;
    double share = fmin(1, how->independent / (double)(asked > 1 ? asked : 1)), least = wide * wide * wide;
    double a = share * spread[0] + wide, b = share * spread[1] + wide, c = share * spread[2] + wide;
    double d = share * spread[3], e = share * spread[4], f = share * spread[5];
    double volume = a * (b * c - f * f) - d * (d * c - e * f) + e * (d * f - b * e);
    if (volume < least) volume = least;
    return 0.5 * log(volume) - how->constant - 0.5 * share * square;
}

static double precision_of(double mean, double variance) {
    return isfinite(mean) && isfinite(variance) ? 1 / variance : 0;
}

/* Of B tracklets, S samples each: frame (B, S) or -1, xyz (B, S, 3), own marker (B,) or -1; placed (T, M, 3) by frame.
 * Log odds (B, M) of the markers that are `asked` (B, M) of each, the mean of the frames that know enough; NaN of the
 * others, and where these frames are fewer than half of those looked at. `scratch` holds M * (Q + 8). */
KERNEL void of_frames(const Likeness *how, int64_t count, int64_t samples, int64_t M, const int64_t *frame,
                      const float *xyz, const float *placed, const int64_t *own, const uint8_t *asked, double *odds,
                      double *scratch) {
    int64_t Q = how->near_count;
    double *precision = scratch, *known = precision + M * Q;
    Seen seen = {.distance = known + M, .products = known + 2 * M};
    for (int64_t i = 0; i < M * Q; i++) precision[i] = precision_of(how->mean[i], how->variance[i]);
    for (int64_t b = 0; b < count; b++) {
        const uint8_t *wanted = asked + b * M;
        double *sum = odds + b * M, frames = 0;
        for (int64_t m = 0; m < M; m++) sum[m] = known[m] = 0;
        for (int64_t at = b * samples; at < (b + 1) * samples; at++) {
            if (frame[at] < 0) continue;
            frames++;
            look(M, xyz + 3 * at, placed + frame[at] * M * 3, &seen);
            for (int64_t m = 0; m < M; m++) {
                if (!wanted[m]) continue;
                double said = odds_of_marker(how, how->near + m * Q, how->mean + m * Q, precision + m * Q, own[b], &seen);
                if (!isfinite(said)) continue;
                sum[m] += said;
                known[m]++;
            }
        }
        for (int64_t m = 0; m < M; m++) sum[m] = known[m] > 0 && 2 * known[m] >= frames ? sum[m] / known[m] : NAN;
    }
}

/* Of N ends of tracklets at xyz (N, 3) in their frames (N,), own marker (N,) or -1; placed (F, M, 3) by frame, `how`
 * with the variance of distances at any time. Log odds (N, M) that each is what the marker was when it was seen next, in
 * frames `then` (N, M), `gap` (N, M) away, of which the distances change in `change` frames and by a variance of
 * `least` in none; 0 where nothing is known, and where `then` is -1. `scratch` holds 2 * Q + 7 * M. */
KERNEL void of_ends(const Likeness *how, int64_t count, int64_t M, double change, double least, const int64_t *frame,
                    const int64_t *then, const double *gap, const float *xyz, const float *placed, const int64_t *own,
                    double *odds, double *scratch) {
    int64_t Q = how->near_count;
    double *mean = scratch, *precision = scratch + Q;
    Seen seen = {.distance = precision + Q, .products = precision + Q + M};
    for (int64_t n = 0; n < count; n++) {
        look(M, xyz + 3 * n, placed + frame[n] * M * 3, &seen);
        for (int64_t m = 0; m < M; m++) {
            int64_t at = n * M + m;
            odds[at] = 0;
            if (then[at] < 0) continue;
            const int64_t *near = how->near + m * Q;
            const float *old = placed + then[at] * M * 3;
            double changed = gap[at] / change, part = fmin(changed * changed, 1);
            for (int64_t q = 0; q < Q; q++) {
                double away[3];
                for (int i = 0; i < 3; i++) away[i] = (double)old[3 * m + i] - old[3 * near[q] + i];
                mean[q] = sqrt(dot3(away, away));
                precision[q] = precision_of(mean[q], least + how->variance[m * Q + q] * part);
            }
            double said = odds_of_marker(how, near, mean, precision, own[n], &seen);
            if (!isnan(said)) odds[at] = said;
        }
    }
}

/* Of all distances between the markers of F frames (F, M, 3), NaN where one is missing: their sum, that of their squares
 * and their number, (M, M) each. `scratch` holds 3 * M. */
KERNEL void distance_sums(int64_t F, int64_t M, const double *points, double *total, double *squares, double *count,
                          double *scratch) {
    double *x = scratch, *y = x + M, *z = y + M;
    memset(total, 0, (size_t)(M * M) * sizeof(double));
    memset(squares, 0, (size_t)(M * M) * sizeof(double));
    memset(count, 0, (size_t)(M * M) * sizeof(double));
    for (int64_t f = 0; f < F; f++) {
        for (int64_t m = 0; m < M; m++) {
            const double *place = points + (f * M + m) * 3;
            x[m] = place[0], y[m] = place[1], z[m] = place[2];
        }
        for (int64_t m = 0; m < M; m++) {
            double *sums = total + m * M, *second = squares + m * M, *number = count + m * M;
            for (int64_t o = 0; o <= m; o++) {
                double a = x[m] - x[o], b = y[m] - y[o], c = z[m] - z[o], square = a * a + b * b + c * c;
                int there = square == square;
                square = there ? square : 0;
                sums[o] += sqrt(square);
                second[o] += square;
                number[o] += there ? 1 : 0;
            }
        }
    }
    for (int64_t m = 0; m < M; m++)
        for (int64_t o = 0; o < m; o++) {
            total[o * M + m] = total[m * M + o];
            squares[o * M + m] = squares[m * M + o];
            count[o * M + m] = count[m * M + o];
        }
}
