/* SPDX-License-Identifier: GPL-3.0-or-later */
/* Vectors of three and matrices of three by three, row by row. */

#ifndef MOCAP_AUTOLABEL_SMALL_H
#define MOCAP_AUTOLABEL_SMALL_H

static inline double dot3(const double *a, const double *b) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }

static inline void matmul3(const double *a, const double *b, double *out) {
    for (int r = 0; r < 3; r++)
        for (int c = 0; c < 3; c++) out[3 * r + c] = a[3 * r] * b[c] + a[3 * r + 1] * b[3 + c] + a[3 * r + 2] * b[6 + c];
}

static inline void apply3(const double *matrix, const double *vector, double *out) {
    for (int r = 0; r < 3; r++) out[r] = dot3(matrix + 3 * r, vector);
}

static inline double clamp(double value, double low, double high) {
    return value < low ? low : value > high ? high : value;
}

#endif
