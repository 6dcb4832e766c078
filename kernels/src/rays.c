/* SPDX-License-Identifier: GPL-3.0-or-later */
/* Markers in space from their blobs' rays: `addon/core/geometry/triangulation.py`. */

#include <math.h>
#include <string.h>

#include "parts.h"
#include "small.h"

#define SHORTEST 1e-3
#define MOST_CAMERAS 1024

/* Rays of blobs image (C, K, 2): direction (C, K, 3), the projection across it (C, K, 3, 3) and that of the centre. */
KERNEL void blob_rays(int64_t C, int64_t K, const double *image, const double *rotation, const double *centres,
                      double *direction, double *across, double *anchor) {
    for (int64_t c = 0; c < C; c++)
        for (int64_t k = 0; k < K; k++) {
            int64_t at = c * K + k;
            double local[3] = {image[2 * at], image[2 * at + 1], 1}, *d = direction + 3 * at, *a = across + 9 * at;
            for (int x = 0; x < 3; x++)
                d[x] = local[0] * rotation[9 * c + x] + local[1] * rotation[9 * c + 3 + x] + local[2] * rotation[9 * c + 6 + x];
            double length = sqrt(dot3(d, d));
            for (int x = 0; x < 3; x++) d[x] /= length;
            for (int r = 0; r < 3; r++)
                for (int x = 0; x < 3; x++) a[3 * r + x] = (r == x) - d[r] * d[x];
            apply3(a, centres + 3 * c, anchor + 3 * at);
        }
}

/* The point nearest to the weighted rays of one marker; 0 where they do not fix one. */
static int nearest(int64_t C, int64_t K, int64_t M, const double *across, const double *anchor, const int64_t *slot,
                   const double *weight, double ridge, double max_condition, double point[3]) {
    double normal[9] = {0}, right[3] = {0}, inverse[9];
    for (int64_t c = 0; c < C; c++) {
        if (slot[c * M] < 0) continue;
        const double *a = across + (c * K + slot[c * M]) * 9, *p = anchor + (c * K + slot[c * M]) * 3;
        for (int i = 0; i < 9; i++) normal[i] += weight[c] * a[i];
        for (int i = 0; i < 3; i++) right[i] += weight[c] * p[i];
    }
    double size = normal[0] + normal[4] + normal[8] + ridge;
    for (int i = 0; i < 9; i++) normal[i] = normal[i] / size + (i % 4 == 0) * ridge;
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++) {
            int a = (j + 1) % 3, b = (j + 2) % 3, x = (i + 1) % 3, y = (i + 2) % 3;
            inverse[3 * i + j] = normal[3 * a + x] * normal[3 * b + y] - normal[3 * a + y] * normal[3 * b + x];
        }
    double determinant = normal[0] * inverse[0] + normal[1] * inverse[3] + normal[2] * inverse[6];
    for (int i = 0; i < 9; i++) inverse[i] /= determinant;
    double trace = inverse[0] + inverse[4] + inverse[8];
    apply3(inverse, right, point);
    for (int i = 0; i < 3; i++) point[i] /= size;
    return !(trace > max_condition) && isfinite(trace);
}

/* Where one marker's rays meet: slots (C,) with `stride`, depth (C,) or NULL; miss and scratch (C,). */
static void meet_slots(int64_t C, int64_t K, int64_t stride, const int64_t *slot, const double *depth,
                       const double *across, const double *anchor, const double *centres, double ridge,
                       double max_condition, double *point, double *residual, double *miss, double *scratch) {
    double sum = 0;
    int64_t count = 0;
    for (int64_t c = 0; c < C; c++) {
        count += slot[c * stride] >= 0;
        scratch[c] = 1;
        miss[c * stride] = 0;
    }
    int fixed = count >= 2;
    if (fixed && !depth) fixed = nearest(C, K, stride, across, anchor, slot, scratch, ridge, max_condition, point);
    for (int64_t c = 0; fixed && c < C; c++) {
        double arm[3] = {point[0] - centres[3 * c], point[1] - centres[3 * c + 1], point[2] - centres[3 * c + 2]};
        double far = fmax(depth ? depth[c * stride] : sqrt(dot3(arm, arm)), SHORTEST);
        scratch[c] = 1 / (far * far);
    }
    if (fixed) fixed = nearest(C, K, stride, across, anchor, slot, scratch, ridge, max_condition, point);
    if (!fixed) {
        point[0] = point[1] = point[2] = *residual = NAN;
        return;
    }
    for (int64_t c = 0; c < C; c++) {
        if (slot[c * stride] < 0) continue;
        double arm[3] = {point[0] - centres[3 * c], point[1] - centres[3 * c + 1], point[2] - centres[3 * c + 2]};
        double missing[3];
        apply3(across + (c * K + slot[c * stride]) * 9, arm, missing);
        double square = dot3(missing, missing);
        sum += square;
        miss[c * stride] = sqrt(square);
    }
    *residual = sqrt(sum / (double)count);
}

/* Meets the blobs in slots (C, M); depth (C, M) or NULL. points (M, 3), residual (M,), miss (C, M); scratch holds C. */
KERNEL void meet(int64_t C, int64_t K, int64_t M, const int64_t *slot, const double *depth, const double *across,
                 const double *anchor, const double *centres, double ridge, double max_condition, double *points,
                 double *residual, double *miss, double *scratch) {
    for (int64_t m = 0; m < M; m++)
        meet_slots(C, K, M, slot + m, depth ? depth + m : NULL, across, anchor, centres, ridge, max_condition,
                   points + 3 * m, residual + m, miss + m, scratch);
}

/* Where the rays in `f->ray` of marker m meet. */
void meet_one(const Frame *f, int64_t m) {
    int64_t C = f->C;
    double depth[MOST_CAMERAS], miss[MOST_CAMERAS], scratch[MOST_CAMERAS];
    for (int64_t c = 0; c < C; c++) depth[c] = f->depth[c * f->M + m];
    meet_slots(C, f->K, 1, f->ray, depth, f->across, f->anchor, f->centres, f->rules->ridge, f->rules->max_condition,
               f->met + 3 * m, f->residual + m, miss, scratch);
    for (int64_t c = 0; c < C; c++) f->miss[c * f->M + m] = miss[c];
}

/* Where two blobs' rays meet; 0 where they fix no point. */
int meet_two(const Frame *f, int64_t c, int64_t k, int64_t d, int64_t l, double point[3], double *residual) {
    double across[18], anchor[6], centres[6], miss[2], scratch[2];
    int64_t slot[2] = {0, 0}, camera[2] = {c < d ? c : d, c < d ? d : c}, blob[2] = {c < d ? k : l, c < d ? l : k};
    for (int i = 0; i < 2; i++) {
        memcpy(across + 9 * i, f->across + (camera[i] * f->K + blob[i]) * 9, 9 * sizeof(double));
        memcpy(anchor + 3 * i, f->anchor + (camera[i] * f->K + blob[i]) * 3, 3 * sizeof(double));
        memcpy(centres + 3 * i, f->centres + 3 * camera[i], 3 * sizeof(double));
    }
    meet_slots(2, 1, 1, slot, NULL, across, anchor, centres, f->rules->ridge, f->rules->max_condition, point, residual,
               miss, scratch);
    return isfinite(*residual);
}
