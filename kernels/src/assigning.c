/* SPDX-License-Identifier: GPL-3.0-or-later */
/* Points given to markers: `one_to_one` of addon/core/points/likelihood/naming.py, and its assigning.py. */

#include <math.h>
#include <stdint.h>

#include "kernels.h"

#define NOTHING -1
#define ROUNDING 1e-9 /* log odds; chains in a circle bring nothing, and must not seem to */

/* The points of one frame on their way to its markers. */
typedef struct {
    int64_t M, P;
    const double *odds;     /* (M, P) */
    double *gained;         /* (M,) where a marker has no point for now, NAN where it was not asked */
    int64_t *holder;        /* (P,) */
    int64_t *robber, *loot; /* (M,) who took which point from each */
    int64_t *waiting;       /* (M,) markers without a point, of which the last is asked first */
} Giving;

/* One more at the end of those who wait; who waits already comes to the end. */
static int64_t put_last(int64_t *waiting, int64_t count, int64_t marker) {
    int64_t kept = 0;
    for (int64_t i = 0; i < count; i++)
        if (waiting[i] != marker) waiting[kept++] = waiting[i];
    waiting[kept] = marker;
    return kept + 1;
}

/* Changes who holds which point, by the best chain that begins with one more marker. */
static void let_in(const Giving *all, int64_t newcomer) {
    int64_t P = all->P, last = newcomer, vacant = NOTHING, count = 1;
    double best = 0;
    for (int64_t m = 0; m < all->M; m++) all->gained[m] = NAN;
    all->gained[newcomer] = 0;
    all->waiting[0] = newcomer;
    while (count) {
        int64_t one = all->waiting[--count];
        const double *odds = all->odds + one * P;
        for (int64_t p = 0; p < P; p++) {
            if (!(odds[p] > 0)) continue;
            int64_t other = all->holder[p];
            double gain = all->gained[one] + odds[p];
            if (other == NOTHING) {
                if (gain > best) best = gain, last = one, vacant = p;
                continue;
            }
            gain -= all->odds[other * P + p];
            if (other == one || gain <= all->gained[other] + ROUNDING) continue;
            all->gained[other] = gain;
            all->robber[other] = one;
            all->loot[other] = p;
            count = put_last(all->waiting, count, other);
            if (gain > best) best = gain, last = other, vacant = NOTHING;
        }
    }
    if (vacant != NOTHING) all->holder[vacant] = last;
    while (last != newcomer) {
        int64_t point = all->loot[last];
        last = all->robber[last];
        all->holder[point] = last;
    }
}

/* The likeliest point of each marker (M,); whether two want the same one, of which `holder` (P,) then says so. */
static int likeliest(const Giving *all, int64_t *naming) {
    int twice = 0;
    for (int64_t p = 0; p < all->P; p++) all->holder[p] = NOTHING;
    for (int64_t m = 0; m < all->M; m++) {
        double most = 0;
        naming[m] = NOTHING;
        for (int64_t p = 0; p < all->P; p++)
            if (all->odds[m * all->P + p] > most) most = all->odds[m * all->P + p], naming[m] = p;
        if (naming[m] == NOTHING) continue;
        twice |= all->holder[naming[m]] != NOTHING;
        all->holder[naming[m]] = m;
    }
    return twice;
}

/* The namings (N, M) of highest total odds (N, M, P). `numbers` holds M numbers, `scratch` P + 3 * M. */
KERNEL void one_to_one(int64_t count, int64_t M, int64_t P, const double *odds, int64_t *naming, double *numbers,
                       int64_t *scratch) {
    for (int64_t n = 0; n < count; n++) {
        int64_t *own = naming + n * M, *robber = scratch + P;
        Giving all = {M, P, odds + n * M * P, numbers, scratch, robber, robber + M, robber + 2 * M};
        if (!likeliest(&all, own)) continue;
        for (int64_t p = 0; p < P; p++) all.holder[p] = NOTHING;
        for (int64_t m = 0; m < M; m++) let_in(&all, m);
        for (int64_t m = 0; m < M; m++) own[m] = NOTHING;
        for (int64_t p = 0; p < P; p++)
            if (all.holder[p] != NOTHING) own[all.holder[p]] = p;
    }
}
