/* SPDX-License-Identifier: GPL-3.0-or-later */
/* Posing bodies, and how their markers move with every parameter: `addon/core/body/bodies.py`. */

#include <math.h>
#include <stddef.h>
#include <string.h>

#include "parts.h"
#include "small.h"

#define NO_TURN 1e-8

static void exponential(const double v[3], double rotation[9], double left[9]) {
    double square = dot3(v, v), angle = sqrt(square);
    double first = 1 - square / 6, second = 0.5, third = 1.0 / 6;
    if (angle >= NO_TURN) {
        first = sin(angle) / angle;
        second = (1 - cos(angle)) / (angle * angle);
        third = (angle - sin(angle)) / (angle * angle * angle);
    }
    double skew[9] = {0, -v[2], v[1], v[2], 0, -v[0], -v[1], v[0], 0}, skew2[9];
    matmul3(skew, skew, skew2);
    for (int i = 0; i < 9; i++) {
        double one = i % 4 == 0;
        rotation[i] = one + first * skew[i] + second * skew2[i];
        left[i] = one + second * skew[i] + third * skew2[i];
    }
}

static void quaternion_to_matrix(const double q[4], double m[9]) {
    double ww = q[0] * q[0], xx = q[1] * q[1], yy = q[2] * q[2], zz = q[3] * q[3];
    double wx = q[0] * q[1], wy = q[0] * q[2], wz = q[0] * q[3];
    double xy = q[1] * q[2], xz = q[1] * q[3], yz = q[2] * q[3];
    m[0] = ww + xx - yy - zz;
    m[1] = 2 * xy - 2 * wz;
    m[2] = 2 * xz + 2 * wy;
    m[3] = 2 * xy + 2 * wz;
    m[4] = ww - xx + yy - zz;
    m[5] = 2 * yz - 2 * wx;
    m[6] = 2 * xz - 2 * wy;
    m[7] = 2 * yz + 2 * wx;
    m[8] = ww - xx - yy + zz;
}

/* Where part `item` (a joint, or a marker behind the joints) of a body sits in its segment's axes, before S. */
static void shaped_offset(const Model *model, const double *shape, const double *own, int64_t item, double out[3]) {
    int64_t parts = model->joints + model->markers;
    for (int x = 0; x < 3; x++) {
        double sum = 0;
        for (int64_t k = 0; k < model->modes; k++) sum += shape[k] * model->shape_modes[(k * parts + item) * 3 + x];
        out[x] = model->offsets[item * 3 + x] + sum;
        if (item >= model->joints) out[x] += own[(item - model->joints) * 3 + x];
    }
}

/* One body: rotations (J, 9), joints (J, 3), markers (M, 3), the offsets (J + M, 3) and left Jacobians (J, 9). */
static void pose_one(const Model *model, const BodyArrays *bodies, int64_t b, double *rotations, double *joints,
                     double *markers, double *offsets, double *left) {
    int64_t J = model->joints, M = model->markers;
    const double *scale = bodies->scale + 3 * b;
    for (int64_t item = 0; item < J + M; item++)
        shaped_offset(model, bodies->shape + b * model->modes, bodies->own + b * M * 3, item, offsets + 3 * item);
    for (int64_t j = 0; j < J; j++) {
        double bend[9], scaled[3], moved[3];
        exponential(bodies->bends + (b * J + j) * 3, bend, left + 9 * j);
        for (int x = 0; x < 3; x++) scaled[x] = offsets[3 * j + x] * scale[x];
        if (j == 0) {
            quaternion_to_matrix(bodies->quaternion + 4 * b, rotations);
            apply3(rotations, scaled, moved);
            for (int x = 0; x < 3; x++) joints[x] = bodies->translation[3 * b + x] + moved[x];
            continue;
        }
        int64_t above = model->parents[j];
        matmul3(rotations + 9 * above, bend, rotations + 9 * j);
        apply3(rotations + 9 * above, scaled, moved);
        for (int x = 0; x < 3; x++) joints[3 * j + x] = joints[3 * above + x] + moved[x];
    }
    for (int64_t m = 0; m < M; m++) {
        int64_t j = model->attachment[m];
        double scaled[3], moved[3];
        for (int x = 0; x < 3; x++) scaled[x] = offsets[3 * (J + m) + x] * scale[x];
        apply3(rotations + 9 * j, scaled, moved);
        for (int x = 0; x < 3; x++) markers[3 * m + x] = joints[3 * j + x] + moved[x];
    }
}

/* `scratch` holds J * 9 + (J + M) * 3 numbers. */
KERNEL void pose(const Model *model, const BodyArrays *bodies, double *rotations, double *joints, double *markers,
                 double *scratch) {
    int64_t J = model->joints, M = model->markers;
    for (int64_t b = 0; b < bodies->count; b++)
        pose_one(model, bodies, b, rotations + b * J * 9, joints + b * J * 3, markers + b * M * 3, scratch + J * 9,
                 scratch);
}

/* What one link of the chain adds to the columns of scale (3) and shape (K): the turn of the segment that carries it,
 * times its offset's or its modes' share along each axis. `total` is (3, 3 + K). */
static void add_link(const Model *model, const double *turn, const double *offset, const double *scale, int64_t item,
                     int64_t with_shape, double *total) {
    int64_t K = model->modes, parts = model->joints + model->markers, width = 3 + K;
    for (int r = 0; r < 3; r++)
        for (int x = 0; x < 3; x++) total[r * width + x] += turn[3 * r + x] * offset[x];
    for (int64_t k = 0; with_shape && k < K; k++) {
        const double *mode = model->shape_modes + (k * parts + item) * 3;
        double scaled[3] = {scale[0] * mode[0], scale[1] * mode[1], scale[2] * mode[2]};
        for (int r = 0; r < 3; r++) total[r * width + 3 + k] += dot3(turn + 3 * r, scaled);
    }
}

/* How one marker moves when a joint that carries it is bent: three columns, at `out` of rows of `width`. */
static void bend_columns(const double *axes, const double *joint, const double *point, int64_t width, double *out) {
    double x = point[0] - joint[0], y = point[1] - joint[1], z = point[2] - joint[2];
    for (int i = 0; i < 3; i++) {
        out[i] = axes[3 + i] * z - axes[6 + i] * y;
        out[width + i] = axes[6 + i] * x - axes[i] * z;
        out[2 * width + i] = axes[i] * y - axes[3 + i] * x;
    }
}

/* The columns of the placement's translation and turn. */
static void rigid_columns(const double *point, const double *translation, int64_t width, double *out) {
    double x = point[0] - translation[0], y = point[1] - translation[1], z = point[2] - translation[2];
    for (int r = 0; r < 3; r++) out[r * width + r] = 1;
    out[4] = z;
    out[5] = -y;
    out[width + 3] = -z;
    out[width + 5] = x;
    out[2 * width + 3] = y;
    out[2 * width + 4] = -x;
}

void derive_one(const Model *model, const BodyArrays *body, int64_t width, double *rotations, double *joints,
                double *markers, double *columns, double *scratch) {
    int64_t J = model->joints, M = model->markers, K = model->modes, link = 3 + K;
    int64_t bends_end = PLACEMENT + 3 * (J - 1), all = width > PLACEMENT;
    double *left = scratch, *axes = left + 9 * J, *offsets = axes + 9 * J, *chain = offsets + 3 * (J + M);
    double *sum = chain + J * 3 * link;
    pose_one(model, body, 0, rotations, joints, markers, offsets, left);
    memset(chain, 0, (size_t)(J * 3 * link) * sizeof(double));
    for (int64_t j = 0; j < J; j++) {
        int64_t above = j ? model->parents[j] : 0;
        if (j) {
            memcpy(chain + j * 3 * link, chain + above * 3 * link, (size_t)(3 * link) * sizeof(double));
            matmul3(rotations + 9 * above, left + 9 * j, axes + 9 * j);
        }
        add_link(model, rotations + 9 * above, offsets + 3 * j, body->scale, j, all, chain + j * 3 * link);
    }
    memset(columns, 0, (size_t)(M * 3 * width) * sizeof(double));
    for (int64_t m = 0; m < M; m++) {
        int64_t own = model->attachment[m];
        double *column = columns + m * 3 * width;
        const double *point = markers + 3 * m;
        rigid_columns(point, body->translation, width, column);
        memcpy(sum, chain + own * 3 * link, (size_t)(3 * link) * sizeof(double));
        add_link(model, rotations + 9 * own, offsets + 3 * (J + m), body->scale, J + m, all, sum);
        for (int r = 0; r < 3; r++) memcpy(column + r * width + 6, sum + r * link, 3 * sizeof(double));
        if (!all) continue;
        for (int r = 0; r < 3; r++) memcpy(column + r * width + bends_end, sum + r * link + 3, (size_t)K * sizeof(double));
        for (int64_t j = 1; j < J; j++)
            if (model->carries[m * (J - 1) + j - 1])
                bend_columns(axes + 9 * j, joints + 3 * j, point, width, column + PLACEMENT + 3 * (j - 1));
    }
}

/* `columns` (B, M, 3, P); `scratch` holds J * 18 + (J + M) * 3 + (J + 1) * 3 * (3 + K) numbers. */
KERNEL void derivatives(const Model *model, const BodyArrays *bodies, double *rotations, double *joints,
                        double *markers, double *columns, double *scratch) {
    int64_t J = model->joints, M = model->markers, K = model->modes, P = PLACEMENT + 3 * (J - 1) + K;
    for (int64_t b = 0; b < bodies->count; b++) {
        BodyArrays one = {1,
                          bodies->translation + 3 * b,
                          bodies->quaternion + 4 * b,
                          bodies->scale + 3 * b,
                          bodies->bends + b * J * 3,
                          bodies->shape + b * K,
                          bodies->own + b * M * 3};
        derive_one(model, &one, P, rotations + b * J * 9, joints + b * J * 3, markers + b * M * 3,
                   columns + b * M * 3 * P, scratch);
    }
}

static void quaternion_product(const double a[4], const double b[4], double out[4]) {
    out[0] = a[0] * b[0] - a[1] * b[1] - a[2] * b[2] - a[3] * b[3];
    out[1] = a[0] * b[1] + a[1] * b[0] + a[2] * b[3] - a[3] * b[2];
    out[2] = a[0] * b[2] + a[2] * b[0] + a[3] * b[1] - a[1] * b[3];
    out[3] = a[0] * b[3] + a[3] * b[0] + a[1] * b[2] - a[2] * b[1];
}

void turn_quaternion(const double quaternion[4], const double vector[3], double out[4]) {
    double angle = sqrt(dot3(vector, vector)), half = angle / 2;
    double share = (half == 0 ? 1 : sin(half) / half) / 2, turn[4] = {cos(half)};
    for (int x = 0; x < 3; x++) turn[x + 1] = share * vector[x];
    quaternion_product(turn, quaternion, out);
    double length = sqrt(out[0] * out[0] + dot3(out + 1, out + 1));
    for (int x = 0; x < 4; x++) out[x] /= length;
}

void turn_between(const double start[4], const double end[4], double out[3]) {
    double back[4] = {start[0], -start[1], -start[2], -start[3]}, product[4];
    quaternion_product(end, back, product);
    double sign = product[0] < 0 ? -1 : 1;
    for (int x = 0; x < 4; x++) product[x] *= sign;
    double sine = sqrt(dot3(product + 1, product + 1));
    double share = sine < NO_TURN ? 2 : 2 * atan2(sine, product[0]) / sine;
    for (int x = 0; x < 3; x++) out[x] = product[x + 1] * share;
}

void third_column(const double quaternion[4], double out[3]) {
    double matrix[9];
    quaternion_to_matrix(quaternion, matrix);
    for (int r = 0; r < 3; r++) out[r] = matrix[3 * r + 2];
}
