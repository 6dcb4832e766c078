/* SPDX-License-Identifier: GPL-3.0-or-later */
/* Blobs that go on in one camera's image: `addon/core/blobs/image_tracklets.py`. */

#include <math.h>

#include "kernels.h"

#define TOO_FAR 1e9

/* m, how far blob k now is from where blob b before should be now; TOO_FAR where either is none. */
static double away(const double *there, const double *image, const uint8_t *real_before, const uint8_t *real, int64_t b,
                   int64_t k, double depth) {
    if (!real_before[b] || !real[k]) return TOO_FAR;
    double x = there[2 * b] - image[2 * k], y = there[2 * b + 1] - image[2 * k + 1];
    return sqrt(x * x + y * y) * depth;
}

/* Of B blobs before and K now in each camera the one that goes on, link (C, K), -1 where none; its speed goes to
 * ahead (C, K, 2), NaN where none. `speed` (C, B, 2) is NaN where nothing is known, depth (C,) m; reach of blobs of
 * known speed and of others. `there` holds 2 B numbers. */
KERNEL void link_blobs(int64_t C, int64_t B, int64_t K, const double *before, const uint8_t *real_before,
                       const double *speed, const double *image, const uint8_t *real, const double *depth,
                       double known_reach, double reach, double other_ratio, double other, int64_t *link, double *ahead,
                       double *there) {
    for (int64_t c = 0; c < C; c++, before += 2 * B, speed += 2 * B, real_before += B, image += 2 * K, real += K) {
        int64_t *own = link + c * K;
        double *moved = ahead + 2 * c * K;
        for (int64_t b = 0; b < 2 * B; b++) there[b] = before[b] + (isnan(speed[b & ~(int64_t)1]) ? 0 : speed[b]);
        for (int64_t k = 0; k < K; k++) {
            own[k] = -1;
            moved[2 * k] = moved[2 * k + 1] = NAN;
        }
        for (int64_t b = 0; b < B; b++) {
            double least = TOO_FAR;
            int64_t nearest = -1, others = 0;
            for (int64_t k = 0; k < K; k++) {
                double off = away(there, image, real_before, real, b, k, depth[c]);
                if (off < least) {
                    least = off;
                    nearest = k;
                }
            }
            if (nearest < 0 || !(least < (isnan(speed[2 * b]) ? reach : known_reach))) continue;
            double room = other_ratio * least + other;
            for (int64_t k = 0; k < K; k++) others += away(there, image, real_before, real, b, k, depth[c]) < room;
            for (int64_t d = 0; d < B; d++) others += away(there, image, real_before, real, d, nearest, depth[c]) < room;
            if (others != 2) continue;
            own[nearest] = b;
            for (int x = 0; x < 2; x++) moved[2 * nearest + x] = image[2 * nearest + x] - before[2 * b + x];
        }
    }
}
