/* SPDX-License-Identifier: GPL-3.0-or-later */
/* Algorithm 1 on one frame: `addon/core/papers/virtual_occlusions/labelling.py`, whose functions have the same names. */

#include <math.h>
#include <stddef.h>
#include <stdlib.h>
#include <string.h>

#include "parts.h"
#include "small.h"

#define TOO_FAR 1e9
#define SPREAD_UNIT 1e-8
#define NO_POINT_M 1e3

enum { EXCLUSIVE = 0, CONFLICT = 1, REMAINING = 2, BY_EDIT = 3 };
enum { MEETING = 1, REPROJECTION = 2 }; /* what is stale of a marker */

/* (C, M) and (C, M, K) indices. */
#define CM(c, m) ((c) * f->M + (m))
#define CMK(c, m, k) (CM(c, m) * f->K + (k))
#define CK(c, k) ((c) * f->K + (k))

typedef struct {
    double cost;
    int64_t at;
} Candidate;

static void give(const Frame *f, int64_t c, int64_t m, int64_t k, int64_t step) {
    f->slot[CM(c, m)] = k;
    f->step[CM(c, m)] = f->steps[step];
    f->owner[CK(c, k)] = m;
    f->stale[m] = MEETING | REPROJECTION;
}

static void withdraw(const Frame *f, int64_t c, int64_t m) {
    f->owner[CK(c, f->slot[CM(c, m)])] = -1;
    f->slot[CM(c, m)] = -1;
    f->step[CM(c, m)] = 0;
    f->stale[m] = MEETING | REPROJECTION;
}

static int64_t named(const Frame *f, int64_t m) {
    int64_t count = 0;
    for (int64_t c = 0; c < f->C; c++) count += f->slot[CM(c, m)] >= 0;
    return count;
}

/* The spread (2, 2) of an image whose slope is (2, 3), of a point of covariance (3, 3). */
static void image_spread(const double *slope, const double *covariance, double noise, double out[4]) {
    for (int r = 0; r < 2; r++) {
        double half[3];
        for (int x = 0; x < 3; x++)
            half[x] = slope[3 * r] * covariance[x] + slope[3 * r + 1] * covariance[3 + x] + slope[3 * r + 2] * covariance[6 + x];
        for (int q = 0; q < 2; q++) out[2 * r + q] = dot3(half, slope + 3 * q) + (r == q) * noise * noise;
    }
}

/* (K,) twice the negative log-likelihood of one camera's blobs under one marker. */
static void against(const Frame *f, int64_t c, int64_t m, const double image[2], const double spread[4], double *out) {
    double depth = f->depth[CM(c, m)], noise = f->metres[CM(c, m)] / depth, d2 = depth * depth;
    double det = fmax(spread[0] * spread[3] - spread[1] * spread[1], noise * noise * noise * noise), size = NAN;
    for (int64_t k = 0; k < f->K; k++) {
        double x = f->blobs[2 * CK(c, k)] - image[0], y = f->blobs[2 * CK(c, k) + 1] - image[1];
        out[k] = TOO_FAR;
        if (!f->real[CK(c, k)] || !((x * x + y * y) * d2 < f->rules->max_distance * f->rules->max_distance)) continue;
        double square = (x * x * spread[3] + y * y * spread[0] - 2 * x * y * spread[1]) / det;
        if (!(square < f->rules->max_square)) continue;
        if (isnan(size)) size = log(det * d2 * d2 / SPREAD_UNIT);
        out[k] = square + size;
    }
}

/* Where the expected markers should be seen, and how badly each blob fits each of them: `Frame.__init__`. */
static void measure(const Frame *f) {
    blob_rays(f->C, f->K, f->blobs, f->sight->rotation, f->centres, f->direction, f->across, f->anchor);
    for (int64_t c = 0; c < f->C; c++)
        for (int64_t m = 0; m < f->M; m++) {
            int64_t at = CM(c, m);
            double spread[4], *image = f->image + 2 * at, *slope = f->slope + 6 * at;
            f->depth[at] = look_at(f->sight, c, f->points + 3 * m, f->behind, image, slope);
            f->metres[at] = f->rules->pixel / f->focal[c] * f->depth[at] + f->rules->slack;
            image_spread(slope, f->covariance + 9 * m, f->metres[at] / f->depth[at], spread);
            against(f, c, m, image, spread, f->nll + at * f->K);
        }
    for (int64_t c = 0; c < f->C; c++)
        for (int64_t m = 0; m < f->M; m++) {
            int64_t own = f->fixed[CM(c, m)];
            if (own < 0) continue;
            for (int64_t k = 0; k < f->K; k++) f->nll[CMK(c, m, k)] = TOO_FAR;
            for (int64_t n = 0; n < f->M; n++) f->nll[CMK(c, n, own)] = TOO_FAR;
        }
}

/* (K,) of camera `c`: what a marker that another one has named expects of its blobs, `Frame.with_ray`. */
static void with_ray(const Frame *f, int64_t c, int64_t m, int64_t camera, int64_t slot, double *out) {
    const double *slope = f->slope + 6 * CM(camera, m), *cov = f->covariance + 9 * m, *seen = f->slope + 6 * CM(c, m);
    double gain[6], wide[6], noise = f->metres[CM(camera, m)] / f->depth[CM(camera, m)], s[4], left[9], moved[3], spread[4];
    for (int x = 0; x < 3; x++)
        for (int r = 0; r < 2; r++) wide[2 * x + r] = dot3(cov + 3 * x, slope + 3 * r);
    for (int r = 0; r < 2; r++)
        for (int q = 0; q < 2; q++)
            s[2 * r + q] = slope[3 * r] * wide[q] + slope[3 * r + 1] * wide[2 + q] + slope[3 * r + 2] * wide[4 + q] + (r == q) * noise * noise;
    double det = s[0] * s[3] - s[1] * s[2], inverse[4] = {s[3] / det, -s[1] / det, -s[2] / det, s[0] / det};
    for (int x = 0; x < 3; x++)
        for (int r = 0; r < 2; r++) gain[2 * x + r] = wide[2 * x] * inverse[r] + wide[2 * x + 1] * inverse[2 + r];
    double u = f->blobs[2 * CK(camera, slot)] - f->image[2 * CM(camera, m)];
    double v = f->blobs[2 * CK(camera, slot) + 1] - f->image[2 * CM(camera, m) + 1];
    for (int x = 0; x < 3; x++) {
        moved[x] = gain[2 * x] * u + gain[2 * x + 1] * v;
        double row[3];
        for (int y = 0; y < 3; y++) row[y] = gain[2 * x] * slope[y] + gain[2 * x + 1] * slope[3 + y];
        for (int y = 0; y < 3; y++) left[3 * x + y] = cov[3 * x + y] - (row[0] * cov[y] + row[1] * cov[3 + y] + row[2] * cov[6 + y]);
    }
    double image[2] = {f->image[2 * CM(c, m)] + dot3(seen, moved), f->image[2 * CM(c, m) + 1] + dot3(seen + 3, moved)};
    image_spread(seen, left, f->metres[CM(c, m)] / f->depth[CM(c, m)], spread);
    against(f, c, m, image, spread, out);
}

/* (K,) squared deviations of a camera's blobs from a marker's point, and `size`; TOO_FAR where far. */
static void against_point(const Frame *f, int64_t c, int64_t m, double size, double *out) {
    double image[2], slope[6], scale = f->depth[CM(c, m)] / f->metres[CM(c, m)], scale2 = scale * scale;
    double most2 = f->rules->max_off_point * f->rules->max_off_point;
    const double *blob = f->blobs + 2 * CK(c, 0);
    look_at(f->sight, c, f->met + 3 * m, f->behind, image, slope);
    for (int64_t k = 0; k < f->K; k++) {
        double x = blob[2 * k] - image[0], y = blob[2 * k + 1] - image[1], off = (x * x + y * y) * scale2;
        out[k] = off < most2 ? off + size : TOO_FAR;
    }
}

/* (K,) of one camera and marker, `nll_given_names`; where markers meet has to be up to date. */
static void nll_given_names(const Frame *f, int64_t c, int64_t m, double *out) {
    if (isfinite(f->met[3 * m])) {
        double metres = f->metres[CM(c, m)];
        against_point(f, c, m, log(metres * metres * metres * metres / SPREAD_UNIT), out);
        return;
    }
    int64_t rays = 0, only = 0;
    for (int64_t d = 0; d < f->C; d++)
        if (f->slot[CM(d, m)] >= 0 && f->partner[CM(d, m)] < 0 && !rays++) only = d;
    if (rays == 1)
        with_ray(f, c, m, only, f->slot[CM(only, m)], out);
    else
        memcpy(out, f->nll + CM(c, m) * f->K, (size_t)f->K * sizeof(double));
}

/* Brings up to date where named markers meet. */
static void refresh_meetings(const Frame *f) {
    for (int64_t m = 0; m < f->M; m++) {
        if (!(f->stale[m] & MEETING)) continue;
        f->stale[m] &= REPROJECTION;
        for (int64_t c = 0; c < f->C; c++) f->ray[c] = f->partner[CM(c, m)] >= 0 ? -1 : f->slot[CM(c, m)];
        meet_one(f, m);
    }
}

/* The same, and how far blobs are from there. */
static void refresh(const Frame *f) {
    refresh_meetings(f);
    for (int64_t m = 0; m < f->M; m++) {
        if (!f->stale[m]) continue;
        f->stale[m] = 0;
        int known = isfinite(f->met[3 * m]);
        for (int64_t c = 0; c < f->C; c++) {
            double *square = f->reprojection + CM(c, m) * f->K;
            if (known) against_point(f, c, m, 0, square);
            for (int64_t k = 0; !known && k < f->K; k++) square[k] = TOO_FAR;
        }
    }
}

/* (K,) of a camera: the visible marker that fits each blob best, -1 for none; how well, and the second. */
static void closest_markers(const Frame *f, int64_t c, double *best, double *second) {
    for (int64_t k = 0; k < f->K; k++) {
        best[k] = second[k] = TOO_FAR;
        f->closest[k] = -1;
    }
    for (int64_t m = 0; m < f->M; m++) {
        if (!f->visible[CM(c, m)]) continue;
        const double *nll = f->nll + CM(c, m) * f->K;
        for (int64_t k = 0; k < f->K; k++) {
            if (nll[k] < best[k]) {
                second[k] = best[k];
                best[k] = nll[k];
                f->closest[k] = m;
            } else if (nll[k] < second[k])
                second[k] = nll[k];
        }
    }
}

/* Names a camera's blobs that are alone and clear; notes in `claims` what is in conflict. */
static void identify_in(const Frame *f, int64_t c) {
    double *best = f->given, *second = best + f->K, lead = f->rules->min_lead;
    uint8_t *claims = f->claims + CM(c, 0) * f->K;
    memset(claims, 0, (size_t)(f->M * f->K));
    closest_markers(f, c, best, second);
    for (int64_t k = 0; k < f->K; k++) {
        f->unclear[k] = f->closest[k] >= 0 && second[k] - best[k] < lead;
        if (f->closest[k] >= 0) claims[f->closest[k] * f->K + k] = 1;
        for (int64_t m = 0; f->unclear[k] && m < f->M; m++)
            if (f->visible[CM(c, m)] && f->nll[CMK(c, m, k)] - best[k] < lead) claims[m * f->K + k] |= 2;
    }
    for (int64_t m = 0; m < f->M; m++) {
        int64_t own = 0, only = -1;
        for (int64_t k = 0; k < f->K; k++)
            if (claims[m * f->K + k] & 1) {
                own++;
                only = k;
            }
        if (own == 1 && !f->unclear[only]) give(f, c, m, only, EXCLUSIVE);
    }
}

/* Step 1; fills `claims` and gives how many there are. */
static int64_t identify_visible(const Frame *f) {
    int64_t total = 0;
    for (int64_t c = 0; c < f->C; c++) identify_in(f, c);
    for (int64_t c = 0; c < f->C; c++)
        for (int64_t m = 0; m < f->M; m++)
            for (int64_t k = 0; k < f->K; k++) {
                uint8_t *claim = f->claims + CMK(c, m, k);
                if (!*claim) continue;
                *claim = f->slot[CM(c, m)] < 0 && f->owner[CK(c, k)] < 0;
                f->conflicts[m] += *claim;
                total += *claim;
            }
    return total;
}

static void withdraw_unmet(const Frame *f) {
    for (int64_t round = 0; round < f->C; round++) {
        int found = 0;
        refresh_meetings(f);
        for (int64_t m = 0; m < f->M; m++) {
            if (!isfinite(f->met[3 * m])) continue;
            double most = 0, worst = 0;
            int64_t seen = 0, open = 0;
            for (int64_t c = 0; c < f->C; c++) {
                if (f->slot[CM(c, m)] < 0) continue;
                double excess = f->miss[CM(c, m)] / (f->rules->max_miss * f->metres[CM(c, m)]);
                seen++;
                most = fmax(most, excess);
                if (f->fixed[CM(c, m)] >= 0) continue;
                open++;
                worst = fmax(worst, excess);
            }
            if (!(most > 1) || !open) continue;
            found = 1;
            for (int64_t c = 0; c < f->C; c++) {
                if (f->slot[CM(c, m)] < 0 || f->fixed[CM(c, m)] >= 0) continue;
                double excess = f->miss[CM(c, m)] / (f->rules->max_miss * f->metres[CM(c, m)]);
                if (seen < 3 || excess == worst) withdraw(f, c, m);
            }
        }
        if (!found) return;
    }
}

static int in_front(const Frame *f, int64_t c, int64_t behind, int64_t before) {
    const double *a = f->image + 2 * CM(c, behind), *b = f->image + 2 * CM(c, before);
    double depth = f->depth[CM(c, behind)], x = a[0] - b[0], y = a[1] - b[1];
    return (x * x + y * y) * depth * depth < f->rules->overlap * f->rules->overlap &&
           f->depth[CM(c, before)] < depth - f->rules->min_behind;
}

/* Clears what belongs to a marker that stands in front: `open & ~_shadowed`. */
static void clear_shadowed(const Frame *f) {
    double *behind = f->given, *before = behind + f->K;
    for (int64_t c = 0; c < f->C; c++)
        for (int64_t m = 0; m < f->M; m++) {
            uint8_t *open = f->open + CM(c, m) * f->K;
            int known = 0;
            if (!memchr(open, 1, (size_t)f->K)) continue;
            for (int64_t n = 0; n < f->M; n++) {
                if (f->slot[CM(c, n)] >= 0 || !in_front(f, c, m, n)) continue;
                if (!known++) nll_given_names(f, c, m, behind);
                nll_given_names(f, c, n, before);
                for (int64_t k = 0; k < f->K; k++)
                    if (before[k] < fmin(behind[k] + f->rules->min_lead, TOO_FAR)) open[k] = 0;
            }
        }
}

/* Clears blobs that lie on the point of another marker which their camera still lacks: `_better_elsewhere`. */
static void clear_better_elsewhere(const Frame *f) {
    for (int64_t c = 0; c < f->C; c++)
        for (int64_t k = 0; k < f->K; k++) {
            double least = TOO_FAR;
            if (f->owner[CK(c, k)] >= 0) continue;
            for (int64_t m = 0; m < f->M; m++)
                if (f->slot[CM(c, m)] < 0) least = fmin(least, f->reprojection[CMK(c, m, k)]);
            if (!(least < f->rules->max_on_point)) continue;
            for (int64_t m = 0; m < f->M; m++)
                if (f->reprojection[CMK(c, m, k)] > least) f->open[CMK(c, m, k)] = 0;
        }
}

/* Keeps what fits clearly better than all else that is open, of its marker and of its blob: `_undisputed`. */
static void keep_undisputed(const Frame *f) {
    double lead = f->rules->min_lead;
    for (int64_t c = 0; c < f->C; c++) {
        if (!memchr(f->open + CMK(c, 0, 0), 1, (size_t)(f->M * f->K))) continue;
        for (int64_t m = 0; m < f->M; m++)
            for (int64_t k = 0; k < f->K; k++) f->cost[CMK(c, m, k)] = f->open[CMK(c, m, k)] ? f->nll[CMK(c, m, k)] : TOO_FAR;
        for (int64_t m = 0; m < f->M; m++)
            for (int64_t k = 0; k < f->K; k++) {
                double own = f->cost[CMK(c, m, k)];
                int clear = own < TOO_FAR;
                for (int64_t n = 0; clear && n < f->M; n++) clear = n == m || f->cost[CMK(c, n, k)] - own >= lead;
                for (int64_t q = 0; clear && q < f->K; q++) clear = q == k || f->cost[CMK(c, m, q)] - own >= lead;
                f->open[CMK(c, m, k)] = (uint8_t)clear;
            }
    }
}

static int solve3(const double *matrix, const double *right, double *out) {
    double a[9], cross[9];
    memcpy(a, matrix, sizeof a);
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++) {
            int p = (j + 1) % 3, q = (j + 2) % 3, x = (i + 1) % 3, y = (i + 2) % 3;
            cross[3 * i + j] = a[3 * p + x] * a[3 * q + y] - a[3 * p + y] * a[3 * q + x];
        }
    double determinant = a[0] * cross[0] + a[1] * cross[3] + a[2] * cross[6];
    apply3(cross, right, out);
    for (int i = 0; i < 3; i++) out[i] /= determinant;
    return determinant != 0;
}

/* How far the point of a candidate and the marker's only other blob lies from the model's marker: `_one_helper_cost`. */
static double one_helper_cost(const Frame *f, int64_t c, int64_t m, int64_t k) {
    double point[3], residual, away[3], whitened[3], cov[9], square = 0;
    int64_t helper = 0;
    while (helper < f->C && f->slot[CM(helper, m)] < 0) helper++;
    if (helper == f->C) return TOO_FAR;
    if (!meet_two(f, c, k, helper, f->slot[CM(helper, m)], point, &residual)) return TOO_FAR;
    if (!(residual < f->rules->max_miss * f->metres[CM(c, m)])) return TOO_FAR;
    for (int i = 0; i < 9; i++) cov[i] = f->covariance[9 * m + i] + (i % 4 == 0) * f->rules->slack * f->rules->slack;
    for (int x = 0; x < 3; x++) away[x] = point[x] - f->points[3 * m + x];
    if (!solve3(cov, away, whitened)) return TOO_FAR;
    square = dot3(away, whitened);
    return square < f->rules->max_off_model ? square : TOO_FAR;
}

static int by_cost(const void *a, const void *b) {
    const Candidate *first = a, *second = b;
    if (first->cost != second->cost) return first->cost < second->cost ? -1 : 1;
    return first->at < second->at ? -1 : first->at > second->at;
}

/* Names greedily, best first, one blob a marker and one marker a blob in every camera; of what is open only. */
static void give_best(const Frame *f, int64_t step) {
    Candidate *order = f->order;
    int64_t count = 0, rows = f->C * f->M;
    for (int64_t row = 0; row < rows; row++) {
        if (!memchr(f->open + row * f->K, 1, (size_t)f->K)) continue;
        for (int64_t at = row * f->K; at < (row + 1) * f->K; at++)
            if (f->open[at] && f->cost[at] < TOO_FAR) {
                order[count].cost = f->cost[at];
                order[count++].at = at;
            }
    }
    qsort(order, (size_t)count, sizeof(Candidate), by_cost);
    for (int64_t i = 0; i < count; i++) {
        int64_t k = order[i].at % f->K, m = order[i].at / f->K % f->M, c = order[i].at / f->K / f->M;
        if (f->slot[CM(c, m)] < 0 && f->owner[CK(c, k)] < 0) give(f, c, m, k, step);
    }
}

enum { BY_POINT, BY_HELPER, BY_MODEL };

static void cost_open(const Frame *f, int how) {
    if (how == BY_MODEL) {
        keep_undisputed(f);
        return; /* which has left the model's cost there */
    }
    for (int64_t row = 0; row < f->C * f->M; row++) {
        int64_t c = row / f->M, m = row % f->M, first = row * f->K;
        if (!memchr(f->open + first, 1, (size_t)f->K)) continue;
        for (int64_t k = 0; k < f->K; k++)
            if (f->open[first + k])
                f->cost[first + k] = how == BY_POINT ? f->reprojection[first + k] : one_helper_cost(f, c, m, k);
    }
}

/* Opens what is free of a marker, where `wanted` (C, M, K) has it if there is one; 0 where there is nothing. */
static int open_free(const Frame *f, int64_t m, const uint8_t *wanted, int likely) {
    int any = 0;
    for (int64_t c = 0; c < f->C; c++) {
        uint8_t *open = f->open + CM(c, m) * f->K;
        memset(open, 0, (size_t)f->K);
        if (f->slot[CM(c, m)] >= 0) continue;
        for (int64_t k = 0; k < f->K; k++) {
            if (f->owner[CK(c, k)] >= 0 || !f->real[CK(c, k)]) continue;
            if ((wanted && !wanted[CMK(c, m, k)]) || (likely && !(f->nll[CMK(c, m, k)] < TOO_FAR))) continue;
            open[k] = 1;
            any = 1;
        }
    }
    return any;
}

static void close_all(const Frame *f, int64_t m) {
    for (int64_t c = 0; c < f->C; c++) memset(f->open + CM(c, m) * f->K, 0, (size_t)f->K);
}

/* Step 2. */
static void resolve_conflicts(const Frame *f) {
    for (int64_t helpers = 2; helpers >= 0; helpers--) {
        int any = 0;
        for (int64_t m = 0; m < f->M; m++) {
            int64_t have = named(f, m);
            if (helpers == 2 ? have >= 2 : have == helpers)
                any |= open_free(f, m, f->claims, 0);
            else
                close_all(f, m);
        }
        if (!any) continue;
        refresh(f);
        clear_better_elsewhere(f);
        clear_shadowed(f);
        cost_open(f, helpers == 2 ? BY_POINT : helpers == 1 ? BY_HELPER : BY_MODEL);
        give_best(f, CONFLICT);
    }
}

/* Step 3. */
static void name_remaining(const Frame *f) {
    refresh(f);
    for (int64_t m = 0; m < f->M; m++) open_free(f, m, NULL, 0);
    clear_shadowed(f);
    cost_open(f, BY_POINT);
    give_best(f, REMAINING);
    for (int64_t helpers = 1; helpers >= 0; helpers--) {
        int any = 0;
        for (int64_t m = 0; m < f->M; m++)
            if (named(f, m) == helpers)
                any |= open_free(f, m, NULL, 1);
            else
                close_all(f, m);
        if (!any) continue;
        cost_open(f, helpers ? BY_HELPER : BY_MODEL);
        give_best(f, REMAINING);
    }
}

/* What two markers may have made of one blob. */
typedef struct {
    double square;
    int64_t at, camera, first, second, slot;
    int alone;
} Pair;

static int by_square(const void *a, const void *b) {
    const Pair *first = a, *second = b;
    if (first->square != second->square) return first->square < second->square ? -1 : 1;
    return first->at < second->at ? -1 : first->at > second->at;
}

/* The free blob nearest to the middle of two markers. */
static Pair merged(const Frame *f, int64_t c, int64_t m, int64_t n) {
    double reach2 = f->rules->merged * f->rules->merged, depth = f->depth[CM(c, m)];
    const double *a = f->image + 2 * CM(c, m), *b = f->image + 2 * CM(c, n);
    double u = (a[0] + b[0]) / 2, v = (a[1] + b[1]) / 2;
    Pair pair = {TOO_FAR, 0, c, m, n, 0, 0};
    for (int64_t k = 0; k < f->K; k++) {
        if (f->owner[CK(c, k)] >= 0 || !f->real[CK(c, k)]) continue;
        double x = f->blobs[2 * CK(c, k)] - u, y = f->blobs[2 * CK(c, k) + 1] - v;
        double square = (x * x + y * y) * (depth * depth);
        pair.alone += square < reach2;
        if (square < pair.square) {
            pair.square = square;
            pair.slot = k;
        }
    }
    return pair;
}

static void name_merged(const Frame *f) {
    double reach2 = f->rules->merged * f->rules->merged;
    Pair *pairs = f->order;
    int64_t count = 0, room = f->pairs;
    for (int64_t c = 0; c < f->C; c++)
        for (int64_t m = 0; m < f->M; m++) {
            if (f->slot[CM(c, m)] >= 0) continue;
            for (int64_t n = 0; n < f->M; n++) {
                if (n == m || f->slot[CM(c, n)] >= 0 || f->depth[CM(c, m)] > f->depth[CM(c, n)]) continue;
                const double *a = f->image + 2 * CM(c, m), *b = f->image + 2 * CM(c, n);
                double x = a[0] - b[0], y = a[1] - b[1], depth = f->depth[CM(c, m)];
                if (!((x * x + y * y) * (depth * depth) < reach2) || count == room) continue;
                Pair pair = merged(f, c, m, n);
                pair.at = count;
                if (pair.alone == 1 && pair.square < reach2 / 4) pairs[count++] = pair;
            }
        }
    qsort(pairs, (size_t)count, sizeof(Pair), by_square);
    for (int64_t i = 0; i < count; i++) {
        const Pair *p = pairs + i;
        if (f->slot[CM(p->camera, p->first)] >= 0 || f->owner[CK(p->camera, p->slot)] >= 0) continue;
        give(f, p->camera, p->first, p->slot, REMAINING);
        f->partner[CM(p->camera, p->first)] = p->second;
    }
}

static int any_free(const Frame *f) {
    for (int64_t i = 0; i < f->C * f->K; i++)
        if (f->owner[i] < 0 && f->real[i]) return 1;
    return 0;
}

/* Nothing is named but what a person named. */
static void begin(const Frame *f) {
    for (int64_t i = 0; i < f->C * f->K; i++) f->owner[i] = -1;
    for (int64_t m = 0; m < f->M; m++) f->conflicts[m] = 0;
    memset(f->stale, MEETING | REPROJECTION, (size_t)f->M);
    for (int64_t c = 0; c < f->C; c++)
        for (int64_t m = 0; m < f->M; m++) {
            f->slot[CM(c, m)] = f->partner[CM(c, m)] = -1;
            f->step[CM(c, m)] = 0;
            if (f->fixed[CM(c, m)] >= 0) give(f, c, m, f->fixed[CM(c, m)], BY_EDIT);
        }
}

void name_one(const Frame *f, int64_t step1_only) {
    measure(f);
    begin(f);
    int64_t claims = identify_visible(f);
    withdraw_unmet(f);
    if (!step1_only && claims) {
        resolve_conflicts(f);
        withdraw_unmet(f);
    }
    if (!step1_only && any_free(f)) {
        name_remaining(f);
        withdraw_unmet(f);
        name_merged(f);
    }
}

/* Algorithm 1, or its first step alone; what a person named is in `fixed`. */
KERNEL void name_markers(const Frame *f, int64_t step1_only) {
    name_one(f, step1_only);
    refresh_meetings(f);
}

/* What makes all other markers together as likely to have made a camera's blob as its own, `mine` being its nll. */
static double odds_of_others(const Frame *f, int64_t c, int64_t m, double mine, double hidden, double shadowed) {
    int64_t k = f->slot[CM(c, m)];
    double odds = 0;
    for (int64_t n = 0; n < f->M; n++) {
        double other = f->given[n * f->K + k];
        if (f->slot[CM(c, n)] >= 0 || n == f->partner[CM(c, m)] || !(other < TOO_FAR)) continue;
        other += f->visible[CM(c, n)] ? 0 : hidden;
        other += in_front(f, c, n, m) ? shadowed : 0;
        odds += exp(clamp((mine - other) / 2, -60, 30));
    }
    return odds;
}

/* How sure each name is, sure (C, M), NaN where there is none; where markers meet is up to date. */
KERNEL void label_confidences(const Frame *f, double hidden, double shadowed, double *sure) {
    double *own = f->given + f->M * f->K;
    for (int64_t c = 0; c < f->C; c++) {
        for (int64_t m = 0; m < f->M; m++)
            if (f->slot[CM(c, m)] < 0) nll_given_names(f, c, m, f->given + m * f->K);
        for (int64_t m = 0; m < f->M; m++) {
            int64_t k = f->slot[CM(c, m)], rays = 0;
            sure[CM(c, m)] = NAN;
            if (k < 0) continue;
            nll_given_names(f, c, m, own);
            for (int64_t d = 0; d < f->C; d++) rays += f->slot[CM(d, m)] >= 0 && f->partner[CM(d, m)] < 0;
            double mine = rays < 3 ? fmax(own[k], f->nll[CMK(c, m, k)]) : own[k];
            if (!(mine < TOO_FAR)) mine = f->rules->max_square;
            sure[CM(c, m)] = 1 / (1 + odds_of_others(f, c, m, mine, hidden, shadowed));
        }
    }
}
