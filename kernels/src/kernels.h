/* SPDX-License-Identifier: GPL-3.0-or-later */
/* The hot loops of Mocap Autolabel. Each function does what the Python function of the same name does; arrays are
 * C-contiguous, sizes were checked by the caller, nothing is allocated but by `fit_body`. */

#ifndef MOCAP_AUTOLABEL_KERNELS_H
#define MOCAP_AUTOLABEL_KERNELS_H

#include <stdint.h>

/* Of what the functions take: raised whenever that changes, here and in addon/core/kernels/library.py. */
#define KERNELS_VERSION 7

#if defined(_WIN32)
#define KERNEL __declspec(dllexport)
#else
#define KERNEL __attribute__((visibility("default")))
#endif

/* A marker set ready for posing: `BodyModel`. Parents come before their children; the root's parent is ignored. */
typedef struct {
    int64_t joints, markers, modes;
    const int64_t *parents;    /* (J,) */
    const int64_t *attachment; /* (M,) */
    const double *offsets;     /* (J + M, 3) heights */
    const double *shape_modes; /* (K, J + M, 3) heights */
    const uint8_t *carries;    /* (M, J - 1) whether bending joint j + 1 moves the marker */
} Model;

/* B bodies: `Bodies`. */
typedef struct {
    int64_t count;
    const double *translation, *quaternion, *scale, *bends, *shape, *own;
} BodyArrays;

/* C cameras: `Sight`. */
typedef struct {
    int64_t count;
    const double *rotation;    /* (C, 3, 3) */
    const double *translation; /* (C, 3) */
    double min_depth;          /* m */
} SightArrays;

/* What is known of people before the data: `Prior`, and `Anchor` where there is a prediction. */
typedef struct {
    double strength, height, upright;
    const double *bend_mean;      /* (3 (J - 1),) */
    const double *bend_precision; /* (3 (J - 1), 3 (J - 1)) */
    const double *scale_precision; /* (3, 3) */
    const double *hessian;        /* (P, P) */
    const double *predicted;      /* one body as a row, see `row_length`, or NULL */
    const double *weight;         /* (P,) */
} PriorArrays;

/* What the data pulls markers to: one of the four of `addon/core/papers/virtual_occlusions/cost.py`. */
enum { RAYS = 0, BLOBS = 1, CLOUD = 2, POINTS = 3 };
typedef struct {
    int64_t kind, sets, size;
    const double *places;  /* RAYS (N, C, M, 2), BLOBS (C, K, 2), CLOUD (Q, 3), POINTS (B, M, 3) */
    const double *weights; /* RAYS deviation (N, C, M), CLOUD weight (Q,) */
    const uint8_t *real;    /* BLOBS (C, K) */
    const uint8_t *visible; /* BLOBS (B, C, M) */
    double softness, reach;
} PullArrays;

/* How steps are damped: `DampingOptions`. */
typedef struct {
    double first, smaller, larger, lowest, highest, ridge;
} DampingArrays;

/* Positions of M markers as a linear function of L latent numbers: `Latent`. */
typedef struct {
    int64_t markers, size;
    const double *mean;     /* (M, 3) m */
    const double *noise;    /* (M,) m2 */
    const double *columns;  /* (M, 3, L) m */
    const double *across;   /* (L, M, 3) the same columns, each in one piece */
    const double *products; /* (M, L, L) of each marker's columns with themselves */
    double yaw_sd;          /* rad */
} Gaussian;

/* Pairs of markers whose distance hardly changes: `DistanceConstraints`. */
typedef struct {
    int64_t count;
    const int64_t *pair;               /* (E, 2) */
    const double *length, *sd, *weight; /* (E,) */
    const int64_t *joined;             /* (M, M) index of the constraint between two markers, or -1 */
    double size_sd, max_cost, max_size_ratio;
} Constraints;

/* What is asked of the Q neighbours of M markers, `LikenessOptions`; `constant` is what all log odds have less. */
typedef struct {
    int64_t near_count, neighbours, min_neighbours;
    const int64_t *near;           /* (M, Q) */
    const double *mean, *variance; /* (M, Q) m, m2 */
    double independent, max_square, wide, constant;
} Likeness;

/* How labels are given: `Rules`. */
typedef struct {
    double pixel, slack, max_distance, max_square, min_lead, max_miss, max_off_point, max_on_point, max_off_model, overlap,
        merged, min_behind, ridge, max_condition;
} RuleArrays;

/* One frame's blobs against one expectation, its names as they grow (`Frame`, `Naming`), and room to work in. */
typedef struct {
    int64_t C, M, K, pairs;
    const SightArrays *sight;
    const RuleArrays *rules;
    double behind; /* where what is behind a camera is seen */
    int64_t steps[4];
    /* given */
    const double *centres, *focal;      /* (C, 3), (C,) */
    const double *blobs;                /* (C, K, 2) */
    const double *points, *covariance;  /* (M, 3), (M, 3, 3) */
    const uint8_t *real, *visible;      /* (C, K), (C, M) */
    const int64_t *fixed;               /* (C, M) */
    /* measured */
    double *image, *slope, *depth, *metres, *nll; /* (C, M, 2), (C, M, 2, 3), (C, M), (C, M), (C, M, K) */
    double *direction, *across, *anchor;          /* see `blob_rays` */
    /* named */
    int64_t *slot, *step, *owner, *partner, *conflicts; /* (C, M), (C, M), (C, K), (C, M), (M,) */
    double *met, *residual, *miss, *reprojection;       /* (M, 3), (M,), (C, M), (C, M, K) */
    /* room */
    double *given, *cost;          /* (M + 1, K), (C, M, K) */
    uint8_t *claims, *open;        /* (C, M, K) each */
    uint8_t *stale, *unclear;      /* (M,), (K,) */
    int64_t *closest, *ray;        /* (K,), (C,) */
    void *order;                   /* C M K candidates or `pairs` pairs */
} Frame;

/* What stays the same while a subject is followed: `Setup`, and the options of following and of a subject. */
typedef struct {
    const Model *model;
    const SightArrays *sight;
    const PriorArrays *prior;
    const DampingArrays *damping;
    const RuleArrays *rules;
    int64_t capsules, fit_steps, min_due, min_meetings;
    const int64_t *segment;                   /* (N,) of each capsule */
    const double *start, *axis, *radius;      /* (N, 3), (N, 3), (N,) heights */
    const double *low, *high;                 /* (C, 2) of what falls on a sensor */
    const double *centres, *focal;            /* (C, 3), (C,) */
    const double *marker_sd, *anchor;         /* (M,) heights, (P,) */
    double behind, ridge, standoff, min_side_share;
    double velocity_kept, velocity_rate, sd, sd_growth, max_sd, lag_kept, own_rate, noise_rate, min_named_share;
    double skin, max_own, min_noise, max_noise, kept_share, trimmed_scale;
} Following;

#endif
