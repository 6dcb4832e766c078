/* SPDX-License-Identifier: GPL-3.0-or-later */
/* What the files of the library have in common: each function works on one body. */

#ifndef MOCAP_AUTOLABEL_PARTS_H
#define MOCAP_AUTOLABEL_PARTS_H

#include "kernels.h"

#define PLACEMENT 9

/* bodies.c: `columns` has `width` numbers a row, nine or all; offsets (J + M, 3), chain see `derivatives`. */
void turn_quaternion(const double quaternion[4], const double vector[3], double out[4]);
KERNEL void pose(const Model *model, const BodyArrays *bodies, double *rotations, double *joints, double *markers,
                 double *scratch);
void turn_between(const double start[4], const double end[4], double out[3]);
void third_column(const double quaternion[4], double out[3]);
void derive_one(const Model *model, const BodyArrays *body, int64_t width, double *rotations, double *joints,
                double *markers, double *columns, double *scratch);

/* cost.c: half of F, or of the squares of named blobs; scratch see `pull_scratch`. */
double pull_one(const PullArrays *pull, const SightArrays *sight, int64_t b, int64_t M, const double *markers,
                double *gradient, double *hessian, double *scratch);

/* Image (2) of a point, its derivative (2, 3) and its depth; what is behind the camera is seen at -`behind`. */
double look_at(const SightArrays *sight, int64_t c, const double *point, double behind, double image[2],
               double slope[6]);

/* naming.c: `name_markers`, but that where markers meet is left as it was asked for last. */
void name_one(const Frame *f, int64_t step1_only);
KERNEL void name_markers(const Frame *f, int64_t step1_only);

/* occlusion.c */
KERNEL void capsules_hide(int64_t count, int64_t K, int64_t M, int64_t C, const double *start, const double *axis,
                          const double *radius, const double *markers, const double *centres, const double *standoff,
                          double min_side_share, uint8_t *hidden);

/* rays.c */
KERNEL void blob_rays(int64_t C, int64_t K, const double *image, const double *rotation, const double *centres,
                      double *direction, double *across, double *anchor);
void meet_one(const Frame *f, int64_t m);
int meet_two(const Frame *f, int64_t c, int64_t k, int64_t d, int64_t l, double point[3], double *residual);

/* fit.c: the upper factor of a matrix (P, P) in place, and solutions by it. */
int factor(double *matrix, int64_t P);
void solve_transposed(const double *matrix, int64_t P, double *sides, int64_t width);
void solve_upper(const double *matrix, int64_t P, double *side);

/* fit.c: bodies as rows. */
int64_t row_length(const Model *model);
BodyArrays body_of(const Model *model, const double *row, const double *own);
void move(const Model *model, const double *row, const double *step, int64_t P, double *out);
void difference(const Model *model, const double *row, const double *origin, double *step);
KERNEL int fit_body(const Model *model, const SightArrays *sight, const PullArrays *pull, const PriorArrays *prior,
                    const DampingArrays *damping, int64_t count, int64_t P, int64_t steps, double *rows,
                    const double *own, double *gradient, double *normal, double *rotations, double *joints,
                    double *markers, double *columns, double *trace, double *scratch);
KERNEL int covariance(int64_t count, int64_t M, int64_t P, const double *normal, const double *columns, double ridge,
                      double *spread, double *scratch);

/* likelihood.c: a marker's part, so much of it, in the upper half of a precision (L, L); markers (M, 3) of a latent vector. */
void add_product(const Gaussian *model, int64_t m, double weight, double *normal);
void positions_of(const Gaussian *model, const double *latent, double *positions);

/* fit.c: see `add_normal` and `damped_step`. */
void add_normal_one(int64_t M, int64_t P, const double *columns, const double *slopes, const double *curves,
                    double *gradient, double *normal, double *scratch);
int damped_step_one(int64_t P, const double *normal, const double *gradient, double damping, double ridge, double *step,
                    double *scratch);

#endif
