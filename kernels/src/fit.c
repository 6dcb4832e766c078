/* SPDX-License-Identifier: GPL-3.0-or-later */
/* Normal equations from one 3 x 3 block a marker, their solution, and the descent: `addon/core/papers/virtual_occlusions/fit.py`. */

#include <math.h>
#include <stddef.h>
#include <string.h>

#include "parts.h"
#include "small.h"

/* Runs of columns that move a marker, as it hangs on few of the joints: where each begins and ends, (count, 2). */
static int64_t moving_runs(int64_t P, const double *x, const double *y, const double *z, int64_t *runs) {
    int64_t count = 0, inside = 0;
    for (int64_t p = 0; p < P; p++) {
        int moves = x[p] != 0 || y[p] != 0 || z[p] != 0;
        if (moves && !inside) runs[2 * count] = p;
        if (!moves && inside) runs[2 * count++ + 1] = p;
        inside = moves;
    }
    if (inside) runs[2 * count++ + 1] = P;
    return count;
}

void add_normal_one(int64_t M, int64_t P, const double *columns, const double *slopes, const double *curves,
                    double *gradient, double *normal, double *scratch) {
    double *u = scratch, *v = u + P, *w = v + P;
    int64_t *runs = (int64_t *)(w + P);
    for (int64_t m = 0; m < M; m++) {
        const double *x = columns + m * 3 * P, *y = x + P, *z = y + P, *slope = slopes + 3 * m, *curve = curves + 9 * m;
        int64_t count = moving_runs(P, x, y, z, runs);
        for (int64_t p = 0; p < P; p++) {
            gradient[p] += slope[0] * x[p] + slope[1] * y[p] + slope[2] * z[p];
            u[p] = curve[0] * x[p] + curve[1] * y[p] + curve[2] * z[p];
            v[p] = curve[3] * x[p] + curve[4] * y[p] + curve[5] * z[p];
            w[p] = curve[6] * x[p] + curve[7] * y[p] + curve[8] * z[p];
        }
        for (int64_t r = 0; r < count; r++)
            for (int64_t p = runs[2 * r]; p < runs[2 * r + 1]; p++) {
                double a = x[p], b = y[p], c = z[p], *row = normal + p * P;
                for (int64_t s = 0; s <= r; s++) {
                    int64_t end = s < r ? runs[2 * s + 1] : p + 1;
                    for (int64_t q = runs[2 * s]; q < end; q++) row[q] += a * u[q] + b * v[q] + c * w[q];
                }
            }
    }
    for (int64_t p = 0; p < P; p++)
        for (int64_t q = 0; q < p; q++) normal[q * P + p] = normal[p * P + q];
}

/* The upper Cholesky factor in place of the upper half of a matrix (P, P); 0 where it is not positive definite.
 * Row by row, four of those above it at a time. */
int factor(double *matrix, int64_t P) {
    for (int64_t i = 0; i < P; i++) {
        double *row = matrix + i * P;
        int64_t k = 0;
        for (; k + 4 <= i; k += 4) {
            const double *a = matrix + k * P, *b = a + P, *c = b + P, *d = c + P;
            double e = a[i], f = b[i], g = c[i], h = d[i];
            for (int64_t j = i; j < P; j++) row[j] = row[j] - e * a[j] - f * b[j] - g * c[j] - h * d[j];
        }
        for (; k < i; k++) {
            const double *above = matrix + k * P;
            double share = above[i];
            for (int64_t j = i; j < P; j++) row[j] -= share * above[j];
        }
        if (!(row[i] > 0)) return 0;
        double root = sqrt(row[i]);
        for (int64_t j = i; j < P; j++) row[j] /= root;
    }
    return 1;
}

/* Solves the transposed upper factor for `width` right sides at once: sides (P, width). */
void solve_transposed(const double *matrix, int64_t P, double *sides, int64_t width) {
    for (int64_t k = 0; k < P; k++) {
        double *row = sides + k * width;
        for (int64_t s = 0; s < width; s++) row[s] /= matrix[k * P + k];
        for (int64_t i = k + 1; i < P; i++) {
            double share = matrix[k * P + i], *other = sides + i * width;
            if (share == 0) continue;
            for (int64_t s = 0; s < width; s++) other[s] -= share * row[s];
        }
    }
}

void solve_upper(const double *matrix, int64_t P, double *side) {
    for (int64_t i = P; i-- > 0;) {
        double sum = side[i];
        for (int64_t k = i + 1; k < P; k++) sum -= matrix[i * P + k] * side[k];
        side[i] = sum / matrix[i * P + i];
    }
}

int damped_step_one(int64_t P, const double *normal, const double *gradient, double damping, double ridge, double *step,
                    double *scratch) {
    double largest = normal[0];
    for (int64_t p = 1; p < P; p++) largest = fmax(largest, normal[p * P + p]);
    double floor = ridge * largest + 1e-12;
    memcpy(scratch, normal, (size_t)(P * P) * sizeof(double));
    memcpy(step, gradient, (size_t)P * sizeof(double));
    for (int64_t p = 0; p < P; p++) scratch[p * P + p] += normal[p * P + p] * damping + floor;
    if (!factor(scratch, P)) return 0;
    solve_transposed(scratch, P, step, 1);
    solve_upper(scratch, P, step);
    return 1;
}

/* How uncertain each marker is: spread (B, M, 3, 3); 0 where a normal is not positive definite.
 * `scratch` holds P * P + P * 3 * M. */
KERNEL int covariance(int64_t count, int64_t M, int64_t P, const double *normal, const double *columns, double ridge,
                      double *spread, double *scratch) {
    double *sides = scratch + P * P;
    int64_t width = 3 * M;
    for (int64_t b = 0; b < count; b++) {
        const double *matrix = normal + b * P * P, *column = columns + b * M * 3 * P;
        double trace = 0, *out = spread + b * M * 9;
        for (int64_t p = 0; p < P; p++) trace += matrix[p * P + p];
        memcpy(scratch, matrix, (size_t)(P * P) * sizeof(double));
        for (int64_t p = 0; p < P; p++) scratch[p * P + p] += ridge * trace;
        if (!factor(scratch, P)) return 0;
        for (int64_t s = 0; s < width; s++)
            for (int64_t p = 0; p < P; p++) sides[p * width + s] = column[s * P + p];
        solve_transposed(scratch, P, sides, width);
        memset(out, 0, (size_t)(M * 9) * sizeof(double));
        for (int64_t p = 0; p < P; p++)
            for (int64_t m = 0; m < M; m++) {
                const double *row = sides + p * width + 3 * m;
                for (int r = 0; r < 3; r++)
                    for (int c = 0; c < 3; c++) out[9 * m + 3 * r + c] += row[r] * row[c];
            }
    }
    return 1;
}

/* A body as a row: translation 3, quaternion 4, scale 3, bends 3 J, shape K. */
int64_t row_length(const Model *model) { return 10 + 3 * model->joints + model->modes; }

BodyArrays body_of(const Model *model, const double *row, const double *own) {
    BodyArrays body = {1, row, row + 3, row + 7, row + 10, row + 10 + 3 * model->joints, own};
    return body;
}

/* The body `row` after a step, as `Bodies.moved`. */
void move(const Model *model, const double *row, const double *step, int64_t P, double *out) {
    int64_t bends = 3 * (model->joints - 1);
    memcpy(out, row, (size_t)row_length(model) * sizeof(double));
    for (int x = 0; x < 3; x++) out[x] += step[x];
    turn_quaternion(row + 3, step + 3, out + 3);
    for (int x = 0; x < 3; x++) out[7 + x] += step[6 + x];
    if (P == PLACEMENT) return;
    for (int64_t i = 0; i < bends; i++) out[13 + i] += step[PLACEMENT + i];
    for (int64_t k = 0; k < model->modes; k++) out[13 + bends + k] += step[PLACEMENT + bends + k];
}

/* The step that leads from one body to another, as `tracking.difference`. */
void difference(const Model *model, const double *row, const double *origin, double *step) {
    int64_t bends = 3 * (model->joints - 1);
    for (int x = 0; x < 3; x++) step[x] = row[x] - origin[x];
    turn_between(origin + 3, row + 3, step + 3);
    for (int x = 0; x < 3; x++) step[6 + x] = row[7 + x] - origin[7 + x];
    for (int64_t i = 0; i < bends + model->modes; i++) step[PLACEMENT + i] = row[13 + i] - origin[13 + i];
}

/* What is known beforehand, as `Prior.terms` and `Anchor.terms`: writes gradient (P,) and normal (P, P). */
static double prior_one(const Model *model, const PriorArrays *prior, const double *row, int64_t P, double *gradient,
                        double *normal, double *scratch) {
    int64_t bends = 3 * (model->joints - 1), K = model->modes, full = PLACEMENT + bends + K;
    const double *shape = row + 13 + bends;
    double cost = 0, up[3], away[3], lean[2] = {0, 0};
    for (int64_t p = 0; p < P; p++) memcpy(normal + p * P, prior->hessian + p * full, (size_t)P * sizeof(double));
    memset(gradient, 0, (size_t)P * sizeof(double));
    for (int x = 0; x < 3; x++) away[x] = row[7 + x] - prior->height;
    for (int x = 0; x < 3; x++) {
        gradient[6 + x] = prior->strength * (away[0] * prior->scale_precision[x] + away[1] * prior->scale_precision[3 + x] +
                                             away[2] * prior->scale_precision[6 + x]);
        cost += away[x] * gradient[6 + x];
    }
    if (prior->upright > 0) {
        third_column(row + 3, up);
        for (int x = 0; x < 2; x++) lean[x] = prior->strength * prior->upright * up[x];
        gradient[3] = -lean[1] * up[2];
        gradient[4] = lean[0] * up[2];
        cost += lean[0] * up[0] + lean[1] * up[1];
    }
    if (P > PLACEMENT) {
        double *off = scratch, *slope = gradient + PLACEMENT;
        for (int64_t i = 0; i < bends; i++) off[i] = row[13 + i] - prior->bend_mean[i];
        for (int64_t i = 0; i < bends; i++)
            for (int64_t j = 0; j < bends; j++) slope[j] += off[i] * prior->bend_precision[i * bends + j];
        for (int64_t j = 0; j < bends; j++) {
            slope[j] *= prior->strength;
            cost += off[j] * slope[j];
        }
        for (int64_t k = 0; k < K; k++) {
            slope[bends + k] = prior->strength * shape[k];
            cost += shape[k] * slope[bends + k];
        }
    }
    if (!prior->predicted) return cost;
    double *change = scratch;
    difference(model, row, prior->predicted, change);
    for (int64_t p = 0; p < P; p++) {
        cost += change[p] * change[p] * prior->weight[p];
        gradient[p] += change[p] * prior->weight[p];
        normal[p * P + p] += prior->weight[p];
    }
    return cost;
}

/* Where one body is in its descent, and everything the next step asks for. */
typedef struct {
    double *row, *gradient, *normal, *rotations, *joints, *markers, *columns;
    double cost;
} Step;

typedef struct {
    const Model *model;
    const SightArrays *sight;
    const PullArrays *pull;
    const PriorArrays *prior;
    const double *own;
    int64_t b, P;
    double *slopes, *curves, *scratch;
} Task;

static void look(const Task *task, Step *step) {
    const Model *model = task->model;
    BodyArrays body = body_of(model, step->row, task->own);
    derive_one(model, &body, task->P, step->rotations, step->joints, step->markers, step->columns, task->scratch);
    step->cost = pull_one(task->pull, task->sight, task->b, model->markers, step->markers, task->slopes, task->curves,
                          task->scratch);
    step->cost += prior_one(model, task->prior, step->row, task->P, step->gradient, step->normal, task->scratch);
    add_normal_one(model->markers, task->P, step->columns, task->slopes, task->curves, step->gradient, step->normal,
                   task->scratch);
}

static void copy(double *to, const double *from, int64_t count) { memcpy(to, from, (size_t)count * sizeof(double)); }

static void keep(const Model *model, int64_t P, const Step *from, Step *to) {
    int64_t J = model->joints, M = model->markers;
    copy(to->row, from->row, row_length(model));
    copy(to->gradient, from->gradient, P);
    copy(to->normal, from->normal, P * P);
    copy(to->rotations, from->rotations, 9 * J);
    copy(to->joints, from->joints, 3 * J);
    copy(to->markers, from->markers, 3 * M);
    copy(to->columns, from->columns, M * 3 * P);
    to->cost = from->cost;
}

/* A step laid out in memory from `at` on; what is behind it. */
static double *laid_out(const Model *model, int64_t P, double *at, Step *step) {
    step->row = at;
    step->gradient = step->row + row_length(model);
    step->normal = step->gradient + P;
    step->rotations = step->normal + P * P;
    step->joints = step->rotations + 9 * model->joints;
    step->markers = step->joints + 3 * model->joints;
    step->columns = step->markers + 3 * model->markers;
    return step->columns + model->markers * 3 * P;
}

/* Damped steps of one body from where it is in `*state`, which changes places with `*tried` where that is better; the
 * cost after each in `trace`, `stride` apart. 0 where a step could not be solved. `scratch` holds P + P * P. */
static int descend(const Task *task, const DampingArrays *damping, int64_t steps, Step **state, Step **tried,
                   double *trace, int64_t stride, double *scratch) {
    double damped = damping->first, *step = scratch, *square = step + task->P;
    for (int64_t s = 0; s < steps; s++) {
        Step *from = *state, *to = *tried;
        if (!damped_step_one(task->P, from->normal, from->gradient, damped, damping->ridge, step, square)) return 0;
        for (int64_t p = 0; p < task->P; p++) step[p] = -step[p];
        move(task->model, from->row, step, task->P, to->row);
        look(task, to);
        int better = to->cost <= from->cost;
        damped *= better ? damping->smaller : damping->larger;
        damped = clamp(damped, damping->lowest, damping->highest);
        if (better) {
            *state = to;
            *tried = from;
        }
        trace[s * stride] = (*state)->cost;
    }
    return 1;
}

/* Damped Gauss-Newton steps of B bodies from rows (B, row_length), in place; `trace` (steps + 1, B). The rest is the
 * `State` at the end. `scratch` is as `fit_scratch` in calls.py says. 0 where a step could not be solved. */
KERNEL int fit_body(const Model *model, const SightArrays *sight, const PullArrays *pull, const PriorArrays *prior,
                    const DampingArrays *damping, int64_t count, int64_t P, int64_t steps, double *rows,
                    const double *own, double *gradient, double *normal, double *rotations, double *joints,
                    double *markers, double *columns, double *trace, double *scratch) {
    int64_t J = model->joints, M = model->markers, length = row_length(model);
    Step second;
    double *slopes = laid_out(model, P, scratch + P + P * P, &second);
    Task task = {model, sight, pull, prior, own, 0, P, slopes, slopes + 3 * M, slopes + 12 * M};
    for (int64_t b = 0; b < count; b++) {
        Step first = {rows + b * length,     gradient + b * P,   normal + b * P * P,       rotations + b * 9 * J,
                      joints + b * 3 * J, markers + b * 3 * M, columns + b * M * 3 * P, 0};
        Step *state = &first, *tried = &second;
        task.b = b;
        task.own = own + b * M * 3;
        look(&task, state);
        trace[b] = state->cost;
        if (!descend(&task, damping, steps, &state, &tried, trace + count + b, count, scratch)) return 0;
        if (state != &first) keep(model, P, state, &first);
    }
    return 1;
}

/* The same, `at_once` steps and then as many again, until a body gained no more than `still`, or `steps` are done: a
 * step that was undone gained nothing, and the next is a shorter one. Only rows (B, row_length) change. `scratch` is as
 * `still_scratch` in calls.py says. */
KERNEL int fit_until_still(const Model *model, const SightArrays *sight, const PullArrays *pull,
                           const PriorArrays *prior, const DampingArrays *damping, int64_t count, int64_t P,
                           int64_t steps, int64_t at_once, double still, double *rows, const double *own,
                           double *scratch) {
    int64_t M = model->markers, length = row_length(model);
    Step first, second;
    double *trace = scratch + P + P * P, *rest = laid_out(model, P, trace + at_once + 1, &first);
    double *slopes = laid_out(model, P, rest, &second);
    Task task = {model, sight, pull, prior, own, 0, P, slopes, slopes + 3 * M, slopes + 12 * M};
    for (int64_t b = 0; b < count; b++) {
        Step *state = &first, *tried = &second;
        task.b = b;
        task.own = own + b * M * 3;
        copy(state->row, rows + b * length, length);
        look(&task, state);
        for (int64_t done = 0; done < steps; done += at_once) {
            int64_t more = steps - done < at_once ? steps - done : at_once;
            trace[0] = state->cost;
            if (!descend(&task, damping, more, &state, &tried, trace + 1, 1, scratch)) return 0;
            double gained = trace[more - 1] - trace[more];
            if (!(gained > still || gained == 0)) break;
        }
        copy(rows + b * length, state->row, length);
    }
    return 1;
}
