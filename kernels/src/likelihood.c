/* SPDX-License-Identifier: GPL-3.0-or-later */
/* Naming points by likelihood: `settled` and `name_odds` of addon/core/points/likelihood/naming.py, `neighbours` of its
 * solving.py, and the distance constraints of its distances.py. */

#include <math.h>
#include <stddef.h>
#include <string.h>

#include "parts.h"
#include "small.h"

#define IMPOSSIBLE -1e6
#define SHORTEST_M 1e-6
#define YAW 3

/* What a distance, m for a subject of mean size, adds to the log likelihood of naming the ends of a constraint. */
static double fit_of(const Constraints *all, int64_t e, double distance) {
    double off = (distance - all->length[e]) / all->sd[e], fit = 0.5 - 0.5 * (off * off);
    return (fit > -all->max_cost ? fit : -all->max_cost) * all->weight[e];
}

static double gap(const double *a, const double *b) {
    double x = a[0] - b[0], y = a[1] - b[1], z = a[2] - b[2];
    return sqrt(x * x + y * y + z * z);
}

/* How far the ends of the constraints are from each other in one naming, m, -1 where one is hidden: (E,). */
static void measure_ends(const Constraints *all, const double *points, const int64_t *naming, double *apart) {
    for (int64_t e = 0; e < all->count; e++) {
        int64_t a = naming[all->pair[2 * e]], b = naming[all->pair[2 * e + 1]];
        apart[e] = a < 0 || b < 0 ? -1 : gap(points + 3 * a, points + 3 * b);
    }
}

/* The size of the subject of one naming; 1 is the mean. `M` markers. */
static double size_of(const Constraints *all, int64_t M, const double *apart) {
    double sum = 0, total = 0;
    for (int64_t e = 0; e < all->count; e++) {
        if (apart[e] < 0) continue;
        double ratio = log(fmax(apart[e], SHORTEST_M) / all->length[e]);
        if (!(fabs(ratio) < all->max_size_ratio)) continue;
        double surety = all->length[e] / all->sd[e], weight = surety * surety * (2 / (double)M);
        sum += weight * ratio;
        total += weight;
    }
    return exp(sum / (total + 1 / (all->size_sd * all->size_sd)));
}

static double total_fit(const Constraints *all, const double *apart, double size) {
    double sum = 0;
    for (int64_t e = 0; e < all->count; e++)
        if (apart[e] >= 0) sum += fit_of(all, e, apart[e] / size);
    return sum;
}

void add_product(const Gaussian *model, int64_t m, double weight, double *normal) {
    int64_t L = model->size;
    const double *product = model->products + m * L * L;
    for (int64_t i = 0; i < L; i++)
        for (int64_t j = i; j < L; j++) normal[i * L + j] += weight * product[i * L + j];
}

void positions_of(const Gaussian *model, const double *latent, double *positions) {
    int64_t width = 3 * model->markers;
    memcpy(positions, model->mean, (size_t)width * sizeof(double));
    for (int64_t l = 0; l < model->size; l++) {
        const double *along = model->across + l * width;
        for (int64_t i = 0; i < width; i++) positions[i] += latent[l] * along[i];
    }
}

/* What follows from which markers are named: the upper factor of the precision (L, L), and how much of the score the
 * namings of these markers have less, but for what a name is worth. */
typedef struct {
    double *factored, logs;
    int64_t named;
} Precision;

/* 0 where it is not positive definite. */
static int weigh(const Gaussian *model, const int64_t *naming, Precision *precision) {
    int64_t L = model->size;
    double *factored = precision->factored;
    memset(factored, 0, (size_t)(L * L) * sizeof(double));
    precision->logs = 0;
    precision->named = 0;
    for (int64_t m = 0; m < model->markers; m++) {
        if (naming[m] < 0) continue;
        add_product(model, m, 1 / model->noise[m], factored);
        precision->logs += 3 * log(model->noise[m]);
        precision->named++;
    }
    for (int64_t l = 0; l < L; l++) factored[l * L + l] += 1;
    if (!factor(factored, L)) return 0;
    for (int64_t l = 0; l < L; l++) precision->logs += 2 * log(factored[l * L + l]);
    return 1;
}

static int same_named(int64_t M, const int64_t *one, const int64_t *other) {
    for (int64_t m = 0; m < M; m++)
        if ((one[m] < 0) != (other[m] < 0)) return 0;
    return 1;
}

/* The latent vector (L,) that named points say, by the upper factor of its precision. */
static void latent_of(const Gaussian *model, const double *points, const int64_t *naming, const double *factored,
                      double *latent) {
    int64_t L = model->size;
    memset(latent, 0, (size_t)L * sizeof(double));
    for (int64_t m = 0; m < model->markers; m++) {
        if (naming[m] < 0) continue;
        for (int x = 0; x < 3; x++) {
            double pull = (points[3 * naming[m] + x] - model->mean[3 * m + x]) / model->noise[m];
            const double *column = model->columns + (3 * m + x) * L;
            for (int64_t l = 0; l < L; l++) latent[l] += pull * column[l];
        }
    }
    solve_transposed(factored, L, latent, 1);
    solve_upper(factored, L, latent);
}

static void turn(double angle, int64_t P, double *points) {
    double cosine = cos(angle), sine = sin(angle);
    for (int64_t p = 0; p < P; p++) {
        double x = points[3 * p], y = points[3 * p + 1];
        points[3 * p] = cosine * x - sine * y;
        points[3 * p + 1] = sine * x + cosine * y;
    }
}

/* One naming, whose precision is known: points (P, 3) with the yaw taken up in place; where the markers are expected
 * (M, 3) and what is left (M, 3). `scratch` holds L + E. */
static void settle_one(const Gaussian *model, const Constraints *all, int64_t P, double *points, const int64_t *naming,
                       double worth, const Precision *precision, double *score, double *size, double *expected,
                       double *left, double *scratch) {
    int64_t M = model->markers, L = model->size;
    double *latent = scratch, *apart = latent + L, square = 0;
    latent_of(model, points, naming, precision->factored, latent);
    turn(-clamp(latent[YAW] * model->yaw_sd, -model->yaw_sd, model->yaw_sd), P, points);
    latent_of(model, points, naming, precision->factored, latent);
    for (int64_t l = 0; l < L; l++) square += latent[l] * latent[l];
    positions_of(model, latent, expected);
    for (int64_t m = 0; m < M; m++)
        for (int64_t i = 3 * m; i < 3 * m + 3; i++) {
            left[i] = naming[m] < 0 ? 0 : points[3 * naming[m] + i - 3 * m] - expected[i];
            square += left[i] * left[i] / model->noise[m];
        }
    measure_ends(all, points, naming, apart);
    *size = size_of(all, M, apart);
    *score = worth * (double)precision->named - 0.5 * (square + precision->logs) + total_fit(all, apart, *size);
}

/* (M, 3, L) half of the expected positions' covariance. `sides` holds 3 * M * L. */
static void spread_of(const Gaussian *model, const double *factored, double *spread, double *sides) {
    int64_t L = model->size, width = 3 * model->markers;
    memcpy(sides, model->across, (size_t)(width * L) * sizeof(double));
    solve_transposed(factored, L, sides, width);
    for (int64_t i = 0; i < width; i++)
        for (int64_t l = 0; l < L; l++) spread[i * L + l] = sides[l * width + i];
}

/* Of N namings (N, M): points (N, P, 3) in place, score and size (N,), expected and left (N, M, 3), spread (N, M, 3, L);
 * the last three may be NULL together. 0 where a precision is not positive definite. `scratch` holds
 * L * L + L + E + 3 * M * (L + 2) numbers. Namings of the same markers after each other share what follows from these. */
KERNEL int settled(const Gaussian *model, const Constraints *all, int64_t count, int64_t P, double *points,
                   const int64_t *naming, const double *worth, double *score, double *size, double *expected,
                   double *left, double *spread, double *scratch) {
    int64_t M = model->markers, L = model->size, width = 3 * M;
    Precision precision = {.factored = scratch};
    double *where = scratch + L * L, *off = where + width, *sides = off + width, *rest = sides + width * L;
    for (int64_t n = 0; n < count; n++) {
        const int64_t *own = naming + n * M;
        int again = n > 0 && same_named(M, own, own - M);
        if (!again && !weigh(model, own, &precision)) return 0;
        settle_one(model, all, P, points + n * P * 3, own, worth[n], &precision, score + n, size + n,
                   expected ? expected + n * width : where, left ? left + n * width : off, rest);
        if (!spread) continue;
        double *out = spread + n * width * L;
        if (again)
            memcpy(out, out - width * L, (size_t)(width * L) * sizeof(double));
        else
            spread_of(model, precision.factored, out, sides);
    }
    return 1;
}

/* Inverse of a symmetric matrix (3, 3), and its determinant. */
static double inverse_of(const double *a, double *out) {
    double aa = a[4] * a[8] - a[5] * a[5], bb = a[2] * a[5] - a[1] * a[8], cc = a[1] * a[5] - a[2] * a[4];
    double determinant = a[0] * aa + a[1] * bb + a[2] * cc;
    out[0] = aa / determinant;
    out[1] = out[3] = bb / determinant;
    out[2] = out[6] = cc / determinant;
    out[4] = (a[0] * a[8] - a[2] * a[2]) / determinant;
    out[5] = out[7] = (a[1] * a[2] - a[0] * a[5]) / determinant;
    out[8] = (a[0] * a[4] - a[1] * a[1]) / determinant;
    return determinant;
}

/* The shared covariance (3, 3) of two markers whose halves are (3, L). */
static void shared_of(int64_t L, const double *one, const double *other, double out[9]) {
    double sum[9] = {0}; /* side by side: one after the other each would wait for its own last addition */
    for (int64_t l = 0; l < L; l++)
        for (int i = 0; i < 9; i++) sum[i] += one[i / 3 * L + l] * other[i % 3 * L + l];
    memcpy(out, sum, sizeof sum);
}

/* `noise` on the diagonal and a matrix times `share`. */
static void with_noise(double noise, double share, const double *matrix, double out[9]) {
    for (int i = 0; i < 9; i++) out[i] = (i % 4 == 0) * noise + share * matrix[i];
}

static double squared(const double *precision, const double *off) {
    double product[3];
    apply3(precision, off, product);
    return dot3(product, off);
}

/* What is known of one marker of a naming, and what all of its neighbours ask for. */
typedef struct {
    const Gaussian *model;
    const Constraints *all;
    int64_t P;
    const double *points, *expected, *left, *spread;
    const uint8_t *present;
    const int64_t *naming;
    double worth, size;
    double *between, *at; /* (P, P) m for a subject of mean size, (M, P) what the constraints say */
    double *own, *mine;   /* (M, 9) own blocks of the covariance, (M, 9) inverse of the noise without them */
} Row;

static void measure_row(const Row *row) {
    int64_t M = row->model->markers, L = row->model->size, P = row->P;
    for (int64_t p = 0; p < P; p++) {
        row->between[p * P + p] = 0;
        for (int64_t q = 0; q < p; q++)
            row->between[p * P + q] = row->between[q * P + p] = gap(row->points + 3 * p, row->points + 3 * q) / row->size;
    }
    memset(row->at, 0, (size_t)(M * P) * sizeof(double));
    for (int64_t e = 0; e < row->all->count; e++)
        for (int end = 0; end < 2; end++) {
            int64_t other = row->naming[row->all->pair[2 * e + 1 - end]];
            if (other < 0) continue;
            const double *distance = row->between + other * P;
            double *out = row->at + row->all->pair[2 * e + end] * P;
            for (int64_t p = 0; p < P; p++) out[p] += fit_of(row->all, e, distance[p]);
        }
    for (int64_t m = 0; m < M; m++) {
        double without[9];
        shared_of(L, row->spread + m * 3 * L, row->spread + m * 3 * L, row->own + 9 * m);
        with_noise(row->model->noise[m], -1, row->own + 9 * m, without);
        inverse_of(without, row->mine + 9 * m);
    }
}

/* (M, P) log odds that a point is a marker, given all named points but the marker's own. */
static void odds_of(const Row *row, double *odds) {
    int64_t P = row->P;
    for (int64_t m = 0; m < row->model->markers; m++) {
        double noise = row->model->noise[m], variance[9], precision[9], without[3], moved[3], pulled[3];
        memcpy(without, row->expected + 3 * m, sizeof without);
        if (row->naming[m] >= 0) {
            for (int i = 0; i < 9; i++) variance[i] = noise * noise * row->mine[9 * m + i];
            apply3(row->mine + 9 * m, row->left + 3 * m, pulled);
            apply3(row->own + 9 * m, pulled, moved);
            for (int x = 0; x < 3; x++) without[x] -= moved[x];
        } else
            with_noise(noise, 1, row->own + 9 * m, variance);
        double logs = log(inverse_of(variance, precision));
        for (int64_t p = 0; p < P; p++) {
            const double *point = row->points + 3 * p;
            double off[3] = {point[0] - without[0], point[1] - without[1], point[2] - without[2]};
            double odd = row->present[p] ? row->worth - 0.5 * (logs + squared(precision, off)) : IMPOSSIBLE;
            odds[m * P + p] = odd + row->at[m * P + p];
        }
    }
}

/* What the constraints of a marker but that with `old` say of a point. */
static double without_constraint(const Row *row, int64_t old, int64_t new, int64_t point) {
    int64_t e = row->all->joined[old * row->model->markers + new];
    double whole = row->at[new * row->P + point];
    return e < 0 ? whole : whole - fit_of(row->all, e, row->between[row->naming[old] * row->P + point]);
}

/* The gain when the point of `old` takes the name of `new`. */
static double move_gain(const Row *row, int64_t old, int64_t new, const double *odds) {
    int64_t L = row->model->size, from = row->naming[old], to = row->naming[new];
    double noise = row->model->noise[new], across[9], carried[9], shared[9], moved[3], expected[3], own[9], variance[9];
    shared_of(L, row->spread + new * 3 * L, row->spread + old * 3 * L, across);
    matmul3(across, row->mine + 9 * old, carried);
    for (int r = 0; r < 3; r++)
        for (int c = 0; c < 3; c++) shared[3 * r + c] = row->own[9 * new + 3 * r + c] + dot3(carried + 3 * r, across + 3 * c);
    apply3(carried, row->left + 3 * old, moved);
    for (int x = 0; x < 3; x++) expected[x] = row->expected[3 * new + x] - moved[x];
    if (to >= 0) {
        double without[9], left[3], pulled[3];
        with_noise(noise, -1, shared, without);
        inverse_of(without, own);
        for (int i = 0; i < 9; i++) variance[i] = noise * noise * own[i];
        for (int x = 0; x < 3; x++) left[x] = row->points[3 * to + x] - expected[x];
        apply3(own, left, pulled);
        apply3(shared, pulled, moved);
        for (int x = 0; x < 3; x++) expected[x] -= moved[x];
    } else
        with_noise(noise, 1, shared, variance);
    double logs = log(inverse_of(variance, own)), gain = -odds[old * row->P + from];
    int64_t tried[2] = {from, to};
    for (int i = 0; i < 2 && tried[i] >= 0; i++) {
        const double *point = row->points + 3 * tried[i];
        double off[3] = {point[0] - expected[0], point[1] - expected[1], point[2] - expected[2]};
        double odd = row->worth - 0.5 * (logs + squared(own, off)) + without_constraint(row, old, new, tried[i]);
        gain += i ? -odd : odd;
    }
    return gain;
}

/* The gain when two named markers exchange points. */
static double swap_gain(const Row *row, int64_t i, int64_t j) {
    int64_t L = row->model->size, P = row->P, a = row->naming[i], b = row->naming[j];
    const double *p = row->points + 3 * a, *q = row->points + 3 * b, *one = row->spread + i * 3 * L;
    const double *other = row->spread + j * 3 * L, *at = row->at;
    double first = 1 / row->model->noise[i], second = 1 / row->model->noise[j], held = 0, slope = 0;
    double off[3] = {q[0] - p[0], q[1] - p[1], q[2] - p[2]};
    double u[3] = {first * off[0], first * off[1], first * off[2]}, v[3] = {second * off[0], second * off[1], second * off[2]};
    for (int64_t l = 0; l < L; l++) {
        double of_one = u[0] * one[l] + u[1] * one[L + l] + u[2] * one[2 * L + l];
        double of_other = v[0] * other[l] + v[1] * other[L + l] + v[2] * other[2 * L + l];
        held += (of_one - of_other) * (of_one - of_other);
    }
    for (int x = 0; x < 3; x++) slope += (row->left[3 * i + x] * first - row->left[3 * j + x] * second) * off[x];
    double gain = -0.5 * (dot3(off, off) * (first + second) - held) - slope;
    gain += at[i * P + b] + at[j * P + a] - at[i * P + a] - at[j * P + b];
    int64_t e = row->all->joined[i * row->model->markers + j];
    return e < 0 ? gain : gain + 2 * (fit_of(row->all, e, row->between[a * P + b]) - fit_of(row->all, e, 0));
}

static void neighbours_of(const Row *row, double reach, const double *odds, double *move, double *swap) {
    int64_t M = row->model->markers;
    for (int64_t i = 0; i < M * M; i++) move[i] = swap[i] = IMPOSSIBLE;
    for (int64_t old = 0; old < M; old++) {
        if (row->naming[old] < 0) continue;
        const double *point = row->points + 3 * row->naming[old];
        for (int64_t new = 0; new < M; new++) {
            double x = point[0] - row->expected[3 * new], y = point[1] - row->expected[3 * new + 1];
            double z = point[2] - row->expected[3 * new + 2];
            if (new != old && x * x + y * y + z * z <= reach * reach) move[old * M + new] = move_gain(row, old, new, odds);
            if (new < old && row->naming[new] >= 0) swap[old * M + new] = swap_gain(row, old, new);
        }
    }
}

/* Of N settled namings: odds (N, M, P), and move and swap (N, M, M) unless they are NULL. `scratch` holds
 * P * P + M * P + 18 * M numbers. */
KERNEL void neighbours(const Gaussian *model, const Constraints *all, int64_t count, int64_t P, const double *points,
                       const uint8_t *present, const int64_t *naming, const double *worth, const double *size,
                       const double *expected, const double *left, const double *spread, double reach, double *odds,
                       double *move, double *swap, double *scratch) {
    int64_t M = model->markers, L = model->size;
    double *at = scratch + P * P, *own = at + M * P;
    for (int64_t n = 0; n < count; n++) {
        Row row = {model,           all,         P,       points + n * P * 3, expected + n * M * 3, left + n * M * 3,
                   spread + n * M * 3 * L, present + n * P, naming + n * M, worth[n], size[n], scratch,
                   at,              own,         own + 9 * M};
        measure_row(&row);
        odds_of(&row, odds + n * M * P);
        if (move) neighbours_of(&row, reach, odds + n * M * P, move + n * M * M, swap + n * M * M);
    }
}
