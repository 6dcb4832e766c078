/* SPDX-License-Identifier: GPL-3.0-or-later */
/* Guesses from nothing: `softly` of addon/core/points/likelihood/starts.py. */

#include <math.h>
#include <stddef.h>
#include <string.h>

#include "parts.h"
#include "small.h"

#define YAW 3
#define FIRST_MODE 4
#define LOWEST -700.0    /* of an exponent: beyond it a density is as good as none */
#define ROUNDING 0x1.8p52 /* what is added to it is rounded to whole numbers */

/* The exponential of a number that is not above 0, to 1e-12: without a branch, so that several are worked out at once.
 * That of a quarter of what is left beyond powers of two, by Taylor's series, and its fourth power. */
static inline double exponential(double x) {
    x = x < LOWEST ? LOWEST : x;
    double shifted = x * 1.4426950408889634 + ROUNDING, power = shifted - ROUNDING;
    double r = 0.25 * (x - power * 0.6931471805599453), square = r * r;
    double low = (1 + r) + square * (1 / 2.0 + r * (1 / 6.0));
    double high = (1 / 24.0 + r * (1 / 120.0)) + square * (1 / 720.0 + r * (1 / 5040.0));
    double sum = low + square * square * high;
    sum *= sum;
    sum *= sum;
    uint64_t bits, twos;
    memcpy(&bits, &sum, sizeof bits);
    memcpy(&twos, &shifted, sizeof twos);
    bits += twos << 52;
    memcpy(&sum, &bits, sizeof sum);
    return sum;
}

/* One start on its way, with those P points that are there. */
typedef struct {
    const Gaussian *model;
    const double *spread; /* (M,) */
    double ghost;
    int64_t P;
    double *x, *y, *z, *likelihood;                 /* (P,) each; likelihood of every point */
    double *share, *fair;                           /* (M, P), (M,) what the shares must yet be multiplied with */
    double *expected, *normal, *latent;             /* (M, 3), (L, L), (L,) */
} Start;

/* (M, P) densities of the points about where the markers are expected, and what they add up to with ghosts. */
static void measure(const Start *start, double loose, double soft) {
    int64_t M = start->model->markers, P = start->P;
    const double *restrict xs = start->x, *restrict ys = start->y, *restrict zs = start->z;
    double *restrict likelihood = start->likelihood;
    for (int64_t p = 0; p < P; p++) likelihood[p] = start->ghost;
    for (int64_t m = 0; m < M; m++) {
        const double place[3] = {start->expected[3 * m], start->expected[3 * m + 1], start->expected[3 * m + 2]};
        double variance = start->model->noise[m] + loose * start->spread[m] + soft, half = -0.5 / variance;
        double height = 1 / (variance * sqrt(variance)), *restrict share = start->share + m * P;
        for (int64_t p = 0; p < P; p++) {
            double x = xs[p] - place[0], y = ys[p] - place[1], z = zs[p] - place[2];
            share[p] = exponential(half * (x * x + y * y + z * z)) * height;
            likelihood[p] += share[p];
        }
    }
}

/* A marker's shares (P,), what they add up to, and the points with them (3,). Even and odd points are added up side by
 * side: one after the other each would wait for the last addition. */
static void sum_shares(const Start *start, double *restrict share, const double *restrict inverse, double *total,
                       double sum[3]) {
    const double *restrict x = start->x, *restrict y = start->y, *restrict z = start->z;
    double sums[4][2] = {{0}};
    int64_t P = start->P, even = P - P % 2;
    for (int64_t p = 0; p < P; p++) share[p] *= inverse[p];
    for (int64_t p = 0; p < even; p += 2)
        for (int i = 0; i < 2; i++) {
            sums[0][i] += share[p + i];
            sums[1][i] += share[p + i] * x[p + i];
            sums[2][i] += share[p + i] * y[p + i];
            sums[3][i] += share[p + i] * z[p + i];
        }
    if (even < P) {
        sums[0][0] += share[even];
        sums[1][0] += share[even] * x[even];
        sums[2][0] += share[even] * y[even];
        sums[3][0] += share[even] * z[even];
    }
    *total = sums[0][0] + sums[0][1];
    for (int i = 0; i < 3; i++) sum[i] = sums[i + 1][0] + sums[i + 1][1];
}

/* Each point among the markers, no marker more than one point; what that says of the latent vector. */
static void share_out(const Start *start, double loose, double soft, double *inverse) {
    const Gaussian *model = start->model;
    int64_t M = model->markers, L = model->size, P = start->P;
    for (int64_t p = 0; p < P; p++) inverse[p] = 1 / start->likelihood[p];
    memset(start->normal, 0, (size_t)(L * L) * sizeof(double));
    memset(start->latent, 0, (size_t)L * sizeof(double));
    for (int64_t m = 0; m < M; m++) {
        double *share = start->share + m * P, total, sum[3];
        sum_shares(start, share, inverse, &total, sum);
        start->fair[m] = 1 / (total > 1 ? total : 1);
        total *= start->fair[m];
        double weight = 1 / (model->noise[m] + loose * start->spread[m] + soft);
        for (int x = 0; x < 3; x++) {
            double pull = (sum[x] * start->fair[m] - total * model->mean[3 * m + x]) * weight;
            const double *column = model->columns + (3 * m + x) * L;
            for (int64_t l = 0; l < L; l++) start->latent[l] += pull * column[l];
        }
        add_product(model, m, total * weight, start->normal);
    }
    for (int64_t l = 0; l < L; l++) start->normal[l * L + l] += 1;
}

/* The yaw of the latent vector put into the points instead. */
static void absorb_yaw(const Start *start) {
    double most = start->model->yaw_sd, back = -clamp(start->latent[YAW] * most, -most, most);
    double cosine = cos(back), sine = sin(back), x = start->latent[0], y = start->latent[1];
    start->latent[0] = cosine * x - sine * y;
    start->latent[1] = sine * x + cosine * y;
    start->latent[YAW] = 0;
    for (int64_t p = 0; p < start->P; p++) {
        x = start->x[p];
        y = start->y[p];
        start->x[p] = cosine * x - sine * y;
        start->y[p] = sine * x + cosine * y;
    }
}

static double fitness_of(const Start *start) {
    double sum = 0, square = 0;
    for (int64_t p = 0; p < start->P; p++) sum += log(start->likelihood[p]);
    for (int64_t l = FIRST_MODE; l < start->model->size; l++) square += start->latent[l] * start->latent[l];
    return sum - 0.5 * square;
}

/* The points (P, 3) that are present (P,) side by side in (3, P); how many there are. */
static int64_t gather(int64_t P, const double *points, const uint8_t *present, double *side) {
    int64_t there = 0;
    for (int64_t p = 0; p < P; p++) {
        if (!present[p]) continue;
        for (int i = 0; i < 3; i++) side[i * P + there] = points[3 * p + i];
        there++;
    }
    return there;
}

/* The points back where they came from, and their shares (M, P), 0 where there is no point. */
static void put_back(const Start *start, int64_t P, const uint8_t *present, double *points, double *share) {
    int64_t there = 0;
    for (int64_t p = 0; p < P; p++) {
        for (int64_t m = 0; m < start->model->markers; m++)
            share[m * P + p] = present[p] ? start->share[m * start->P + there] * start->fair[m] : 0;
        if (!present[p]) continue;
        points[3 * p] = start->x[there];
        points[3 * p + 1] = start->y[there];
        there++;
    }
}

/* N starts: points (N, P, 3), 0 where there is none, and latent (N, L) in place; present (N, P), ghost density (N,), spread
 * (M,) of the markers by the modes, schedule (S, 2) of looseness and softness, m2. Shares (N, M, P) and fitness (N,). 0
 * where a precision is not positive definite. `scratch` holds L * L + M * (P + 4) + 5 * P numbers. */
KERNEL int softly(const Gaussian *model, int64_t count, int64_t P, int64_t steps, double *points, double *latent,
                  const uint8_t *present, const double *ghost, const double *spread, const double *schedule,
                  double *share, double *fitness, double *scratch) {
    int64_t M = model->markers, L = model->size;
    double *x = scratch, *inverse = x + 4 * P, *normal = inverse + P, *fair = normal + L * L, *expected = fair + M;
    for (int64_t n = 0; n < count; n++) {
        const uint8_t *own = present + n * P;
        Start start = {.model = model, .spread = spread, .ghost = ghost[n], .P = gather(P, points + n * P * 3, own, x),
                       .x = x, .y = x + P, .z = x + 2 * P, .likelihood = x + 3 * P, .share = expected + 3 * M,
                       .fair = fair, .expected = expected, .normal = normal, .latent = latent + n * L};
        for (int64_t s = 0; s < steps; s++) {
            positions_of(model, start.latent, expected);
            measure(&start, schedule[2 * s], schedule[2 * s + 1]);
            share_out(&start, schedule[2 * s], schedule[2 * s + 1], inverse);
            if (!factor(normal, L)) return 0;
            solve_transposed(normal, L, start.latent, 1);
            solve_upper(normal, L, start.latent);
            absorb_yaw(&start);
        }
        fitness[n] = fitness_of(&start);
        put_back(&start, P, own, points + n * P * 3, share + n * M * P);
    }
    return 1;
}
