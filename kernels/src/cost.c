/* SPDX-License-Identifier: GPL-3.0-or-later */
/* What the data says to bodies' markers: `addon/core/papers/virtual_occlusions/cost.py`. */

#include <math.h>
#include <string.h>

#include "parts.h"
#include "small.h"

double look_at(const SightArrays *sight, int64_t c, const double *point, double behind, double image[2],
               double slope[6]) {
    const double *turn = sight->rotation + 9 * c, *moved = sight->translation + 3 * c;
    double x = dot3(turn, point) + moved[0], y = dot3(turn + 3, point) + moved[1], z = dot3(turn + 6, point) + moved[2];
    int ahead = z > sight->min_depth;
    double depth = ahead ? z : sight->min_depth, inverse = 1 / depth;
    image[0] = (ahead || behind == 0 ? x : -behind) * inverse;
    image[1] = (ahead || behind == 0 ? y : -behind) * inverse;
    for (int i = 0; i < 3; i++) {
        slope[i] = (turn[i] - image[0] * turn[6 + i]) * inverse;
        slope[3 + i] = (turn[3 + i] - image[1] * turn[6 + i]) * inverse;
    }
    return depth;
}

/* Adds one camera's pull of `weight` towards `toward` to a marker's gradient (3) and Hessian (3, 3). */
static void add_pull(const double slope[6], const double toward[2], double weight, double *gradient, double *hessian) {
    for (int i = 0; i < 3; i++) {
        gradient[i] -= toward[0] * slope[i] + toward[1] * slope[3 + i];
        for (int j = 0; j < 3; j++) hessian[3 * i + j] += weight * (slope[i] * slope[j] + slope[3 + i] * slope[3 + j]);
    }
}

static double ray_pull_one(const PullArrays *pull, const SightArrays *sight, int64_t b, int64_t M,
                           const double *markers, double *gradient, double *hessian) {
    int64_t C = sight->count, set = pull->sets == 1 ? 0 : b;
    double sum = 0;
    for (int64_t m = 0; m < M; m++)
        for (int64_t c = 0; c < C; c++) {
            int64_t at = (set * C + c) * M + m;
            if (!(pull->weights[at] < INFINITY)) continue;
            double found[2], slope[6];
            double depth = look_at(sight, c, markers + 3 * m, 0, found, slope), weight = depth / pull->weights[at];
            weight *= weight;
            if (!(weight > 0)) continue;
            double toward[2] = {(pull->places[2 * at] - found[0]) * weight, (pull->places[2 * at + 1] - found[1]) * weight};
            sum += (toward[0] * toward[0] + toward[1] * toward[1]) / weight;
            add_pull(slope, toward, weight, gradient + 3 * m, hessian + 9 * m);
        }
    return sum;
}

/* Beside `outside`, what is e^-45 of it is lost in rounding, and most pairs of marker and blob are farther apart. */
#define LOST_BESIDE 45

/* What the blobs of one camera say to a body's markers (equation 7); `seen` holds image, slope of each marker. */
static double camera_pull(const PullArrays *pull, int64_t c, int64_t M, const uint8_t *sees, double factor,
                          double outside, const double *seen, double *gradient, double *hessian, double *scratch) {
    int64_t K = pull->size;
    double alone = log(outside), least = alone - LOST_BESIDE;
    const double *blob = pull->places + c * K * 2;
    const uint8_t *real = pull->real + c * K;
    double *chance = scratch, *of_marker = chance + M * K, *of_blob = of_marker + M, sum = 0;
    for (int64_t k = 0; k < K; k++) of_blob[k] = outside;
    for (int64_t m = 0; m < M; m++) {
        double *row = chance + m * K;
        of_marker[m] = outside;
        if (!sees[m]) {
            sum -= alone;
            continue;
        }
        for (int64_t k = 0; k < K; k++) {
            double dx = seen[8 * m] - blob[2 * k], dy = seen[8 * m + 1] - blob[2 * k + 1];
            double square = factor * (dx * dx + dy * dy);
            row[k] = square > least ? exp(square) : 0;
            of_marker[m] += row[k];
            of_blob[k] += row[k];
        }
        sum -= log(of_marker[m]);
    }
    for (int64_t k = 0; k < K; k++) {
        if (real[k]) sum -= log(of_blob[k]);
        of_blob[k] = 1 / of_blob[k];
    }
    for (int64_t m = 0; m < M; m++) {
        if (!sees[m]) continue;
        double toward[2] = {0, 0}, total = 0, share_of_marker = 1 / of_marker[m];
        for (int64_t k = 0; k < K; k++) {
            double share = chance[m * K + k];
            if (share == 0) continue;
            share *= (share_of_marker + of_blob[k]) * -factor;
            total += share;
            toward[0] += share * (blob[2 * k] - seen[8 * m]);
            toward[1] += share * (blob[2 * k + 1] - seen[8 * m + 1]);
        }
        if (total > 0) add_pull(seen + 8 * m + 2, toward, total, gradient + 3 * m, hessian + 9 * m);
    }
    return sum;
}

static double blob_pull_one(const PullArrays *pull, const SightArrays *sight, int64_t b, int64_t M,
                            const double *markers, double *gradient, double *hessian, double *scratch) {
    double ratio = pull->reach / pull->softness, outside = exp(-0.5 * ratio * ratio), sum = 0, *seen = scratch;
    for (int64_t c = 0; c < sight->count; c++) {
        double depth = 0;
        for (int64_t m = 0; m < M; m++) depth += look_at(sight, c, markers + 3 * m, 0, seen + 8 * m, seen + 8 * m + 2);
        double per = depth / (double)M / pull->softness;
        sum += camera_pull(pull, c, M, pull->visible + (b * sight->count + c) * M, -0.5 * per * per, outside, seen,
                           gradient, hessian, scratch + 8 * M);
    }
    return sum;
}

static double cloud_pull_one(const PullArrays *pull, int64_t M, const double *markers, double *gradient,
                             double *hessian, double *chance) {
    double ratio = pull->reach / pull->softness, outside = exp(-0.5 * ratio * ratio), sum = 0;
    double scale = 1 / (pull->softness * pull->softness), least = log(outside) - LOST_BESIDE;
    for (int64_t q = 0; q < pull->size; q++) {
        const double *point = pull->places + 3 * q;
        double of_point = outside, weight = pull->weights[q];
        for (int64_t m = 0; m < M; m++) {
            double dx = point[0] - markers[3 * m], dy = point[1] - markers[3 * m + 1], dz = point[2] - markers[3 * m + 2];
            double square = -0.5 * scale * (dx * dx + dy * dy + dz * dz);
            chance[m] = square > least ? exp(square) : 0;
            of_point += chance[m];
        }
        sum += log(of_point) * weight;
        double per = weight * scale / of_point;
        for (int64_t m = 0; m < M; m++) {
            if (chance[m] == 0) continue;
            double share = chance[m] * per;
            for (int x = 0; x < 3; x++) {
                gradient[3 * m + x] -= share * (point[x] - markers[3 * m + x]);
                hessian[9 * m + 4 * x] += share;
            }
        }
    }
    return -2 * sum;
}

/* Cauchy's loss of the distances to points that are named; `softness` is their noise. */
static double point_pull_one(const PullArrays *pull, int64_t b, int64_t M, const double *markers, double *gradient,
                             double *hessian) {
    double sum = 0, reach2 = pull->reach * pull->reach, noise2 = pull->softness * pull->softness;
    for (int64_t m = 0; m < M; m++) {
        const double *point = pull->places + (b * M + m) * 3, *marker = markers + 3 * m;
        if (!isfinite(point[0]) || !isfinite(point[1]) || !isfinite(point[2])) continue;
        double away[3] = {marker[0] - point[0], marker[1] - point[1], marker[2] - point[2]};
        double square = dot3(away, away) / reach2, weight = 1 / (1 + square) / noise2;
        sum += log1p(square);
        for (int x = 0; x < 3; x++) {
            gradient[3 * m + x] = away[x] * weight;
            hessian[9 * m + 4 * x] = weight;
        }
    }
    return reach2 / noise2 * sum;
}

double pull_one(const PullArrays *pull, const SightArrays *sight, int64_t b, int64_t M, const double *markers,
                double *gradient, double *hessian, double *scratch) {
    memset(gradient, 0, (size_t)(M * 3) * sizeof(double));
    memset(hessian, 0, (size_t)(M * 9) * sizeof(double));
    if (pull->kind == RAYS) return ray_pull_one(pull, sight, b, M, markers, gradient, hessian);
    if (pull->kind == BLOBS) return blob_pull_one(pull, sight, b, M, markers, gradient, hessian, scratch);
    if (pull->kind == POINTS) return point_pull_one(pull, b, M, markers, gradient, hessian);
    return cloud_pull_one(pull, M, markers, gradient, hessian, scratch);
}

/* Markers (B, M, 3); `scratch` holds M * size + size + 9 * M numbers. */
KERNEL void pull(const PullArrays *of, const SightArrays *sight, int64_t count, int64_t M, const double *markers,
                 double *cost, double *gradient, double *hessian, double *scratch) {
    for (int64_t b = 0; b < count; b++)
        cost[b] = pull_one(of, sight, b, M, markers + b * M * 3, gradient + b * M * 3, hessian + b * M * 9, scratch);
}
