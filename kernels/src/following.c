/* SPDX-License-Identifier: GPL-3.0-or-later */
/* One frame of a subject that is followed: `addon/core/blobs/tracking.py`. */

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "parts.h"
#include "small.h"

/* What a track says of its subject; a block of numbers holds these one after the other. */
typedef struct {
    double *row, *own, *own_sd, *velocity, *lag; /* one body, (M, 3) heights, (M,) m, (P,), (M, 3) m */
} Numbers;

/* What a fit says of a frame, one after the other in a block of numbers. */
typedef struct {
    double *row, *rotations, *joints, *markers, *points, *covariance; /* (.), (J, 9), (J, 3), (M, 3), (M, 3), (M, 9) */
} Fitted;

static int64_t parameters(const Model *model) { return PLACEMENT + 3 * (model->joints - 1) + model->modes; }

static Numbers numbers_in(const Model *model, double *block) {
    int64_t M = model->markers;
    Numbers of = {.row = block};
    of.own = of.row + row_length(model);
    of.own_sd = of.own + 3 * M;
    of.velocity = of.own_sd + M;
    of.lag = of.velocity + parameters(model);
    return of;
}

static Fitted fitted_in(const Model *model, double *block) {
    int64_t J = model->joints, M = model->markers;
    Fitted of = {.row = block};
    of.rotations = of.row + row_length(model);
    of.joints = of.rotations + 9 * J;
    of.markers = of.joints + 3 * J;
    of.points = of.markers + 3 * M;
    of.covariance = of.points + 3 * M;
    return of;
}

/* The body where its velocity takes it; `step` holds P numbers. */
static void predict(const Following *with, const Numbers *track, double *row, double *step) {
    int64_t P = parameters(with->model);
    for (int64_t p = 0; p < P; p++) step[p] = with->velocity_kept * track->velocity[p];
    move(with->model, track->row, step, P, row);
}

/* Where the markers should be before the frame is looked at: `_forecast`. */
static void forecast(const Following *with, const Numbers *track, const double *row, const int64_t *unseen,
                     double *points, double *spread, double *scratch) {
    const Model *model = with->model;
    BodyArrays body = body_of(model, row, track->own);
    double *joints = scratch + 9 * model->joints;
    pose(model, &body, scratch, joints, points, joints + 3 * model->joints);
    memset(spread, 0, (size_t)(9 * model->markers) * sizeof(double));
    for (int64_t m = 0; m < model->markers; m++) {
        double sd = fmin(with->sd + with->sd_growth * (double)unseen[m], with->max_sd);
        for (int x = 0; x < 3; x++) {
            points[3 * m + x] += track->lag[3 * m + x];
            spread[9 * m + 4 * x] = sd * sd;
        }
    }
}

/* Images and deviations of named blobs, infinite where none: `slots_pull`. */
static void pull_of_names(const Frame *f, const double *own_sd, double *places, double *weights) {
    for (int64_t m = 0; m < f->M; m++) {
        double rays = 0;
        for (int64_t c = 0; c < f->C; c++) rays += f->slot[c * f->M + m] >= 0;
        for (int64_t c = 0; c < f->C; c++) {
            int64_t at = c * f->M + m, k = f->slot[at];
            const double *blob = f->blobs + 2 * (c * f->K + (k < 0 ? 0 : k));
            memcpy(places + 2 * at, blob, 2 * sizeof(double));
            weights[at] = k < 0 ? INFINITY : sqrt(f->metres[at] * f->metres[at] + rays * (own_sd[m] * own_sd[m]));
        }
    }
}

/* Which markers each camera can see of the fitted body: `Setup.visible`. `room` holds 7 numbers a capsule. */
static void see(const Following *with, const Fitted *fitted, uint8_t *visible, double *room) {
    int64_t N = with->capsules, M = with->model->markers, C = with->sight->count;
    const double *scale = fitted->row + 7;
    double mean = (scale[0] + scale[1] + scale[2]) / 3, standoff = with->standoff * mean;
    double *start = room, *axis = start + 3 * N, *radius = axis + 3 * N, image[2], slope[6];
    for (int64_t n = 0; n < N; n++) {
        const double *turn = fitted->rotations + 9 * with->segment[n], *joint = fitted->joints + 3 * with->segment[n];
        double from[3], along[3];
        for (int x = 0; x < 3; x++) {
            from[x] = with->start[3 * n + x] * scale[x];
            along[x] = with->axis[3 * n + x] * scale[x];
        }
        apply3(turn, from, start + 3 * n);
        apply3(turn, along, axis + 3 * n);
        for (int x = 0; x < 3; x++) start[3 * n + x] += joint[x];
        radius[n] = with->radius[n] * mean;
    }
    capsules_hide(1, N, M, C, start, axis, radius, fitted->markers, with->centres, &standoff, with->min_side_share, visible);
    for (int64_t c = 0; c < C; c++)
        for (int64_t m = 0; m < M; m++) {
            const double *low = with->low + 2 * c, *high = with->high + 2 * c;
            look_at(with->sight, c, fitted->markers + 3 * m, with->behind, image, slope);
            visible[c * M + m] = !visible[c * M + m] && image[0] > low[0] && image[1] > low[1] && image[0] < high[0] && image[1] < high[1];
        }
}

/* Names what is clear from the forecast and fits the body to it. `block` is a track's numbers, `fit` gets
 * what is fitted, `visible` what cameras see of it unless there are no capsules. `frame` is room for names, its blobs
 * given, `scratch` as `Follower` in frame_calls.py says. 0 where the fit could not be done. */
KERNEL int follow_fit(const Following *with, const Frame *frame, double pixel, double *block, const int64_t *unseen,
                      const uint8_t *before, double *fit, uint8_t *visible, double *scratch) {
    const Model *model = with->model;
    int64_t M = model->markers, P = parameters(model), CM = with->sight->count * M, length = row_length(model);
    Numbers track = numbers_in(model, block);
    Fitted fitted = fitted_in(model, fit);
    double *predicted = scratch, *places = predicted + length, *weights = places + 2 * CM, *gradient = weights + CM;
    double *normal = gradient + P, *columns = normal + P * P, *trace = columns + 3 * M * P;
    double *room = trace + with->fit_steps + 1;
    RuleArrays rules = *with->rules;
    Frame named = *frame;
    rules.pixel = pixel;
    named.rules = &rules;
    named.points = fitted.points;
    named.covariance = fitted.covariance;
    named.visible = before;
    predict(with, &track, predicted, room);
    forecast(with, &track, predicted, unseen, fitted.points, fitted.covariance, room);
    name_one(&named, 1);
    pull_of_names(&named, track.own_sd, places, weights);
    PullArrays pull = {.kind = RAYS, .sets = 1, .places = places, .weights = weights};
    PriorArrays prior = *with->prior;
    prior.predicted = predicted;
    prior.weight = with->anchor;
    memcpy(fitted.row, predicted, (size_t)length * sizeof(double));
    if (!fit_body(model, with->sight, &pull, &prior, with->damping, 1, P, with->fit_steps, fitted.row, track.own, gradient,
                  normal, fitted.rotations, fitted.joints, fitted.markers, columns, trace, room))
        return 0;
    if (!covariance(1, M, P, normal, columns, with->ridge, fitted.covariance, room)) return 0;
    for (int64_t m = 0; m < M; m++)
        for (int x = 0; x < 3; x++) {
            fitted.covariance[9 * m + 4 * x] += track.own_sd[m] * track.own_sd[m];
            fitted.points[3 * m + x] = fitted.markers[3 * m + x] + with->lag_kept * track.lag[3 * m + x];
        }
    if (with->capsules) see(with, &fitted, visible, room);
    return 1;
}

/* A marker's squares of what its rays miss, over how many of them are free. */
typedef struct {
    double share, squares, freedom;
} Missed;

static int by_share(const void *a, const void *b) {
    const Missed *first = a, *second = b;
    return first->share < second->share ? -1 : first->share > second->share;
}

/* px, the blobs' noise as the meeting rays show it; NaN when too few do: `pixel_noise`. */
static double pixel_noise(const Following *with, const Frame *f) {
    Missed *missed = f->order;
    int64_t count = 0;
    double squares = 0, freedom = 0;
    for (int64_t m = 0; m < f->M; m++) {
        Missed one = {0, 0, -3};
        for (int64_t c = 0; c < f->C; c++) {
            int64_t at = c * f->M + m;
            if (f->slot[at] < 0 || f->partner[at] >= 0) continue;
            double off = f->miss[at] * with->focal[c] / f->depth[at];
            one.squares += off * off;
            one.freedom += 2;
        }
        one.share = one.squares / one.freedom;
        if (one.freedom > 0 && isfinite(f->residual[m])) missed[count++] = one;
    }
    if (count < with->min_meetings) return NAN;
    qsort(missed, (size_t)count, sizeof(Missed), by_share);
    int64_t kept = (int64_t)ceil(with->kept_share * (double)count);
    for (int64_t i = 0; i < kept; i++) {
        squares += missed[i].squares;
        freedom += missed[i].freedom;
    }
    return sqrt(squares / freedom) * with->trimmed_scale;
}

/* Moves the subject's own offset of a marker towards where it was found: `learn_own`. */
static void learn_own(const Following *with, const Fitted *fitted, const Numbers *track, int64_t m, const double *found,
                      Numbers *next) {
    const double *turn = fitted->rotations + 9 * with->model->attachment[m], *scale = fitted->row + 7;
    double error[3] = {0, 0, 0}, *own = next->own + 3 * m, most = with->max_own * with->marker_sd[m];
    int known = isfinite(found[0]);
    for (int x = 0; known && x < 3; x++) error[x] = found[x] - fitted->markers[3 * m + x];
    for (int x = 0; x < 3; x++) {
        double local = (turn[x] * error[0] + turn[3 + x] * error[1] + turn[6 + x] * error[2]) / scale[x];
        own[x] = track->own[3 * m + x] + with->own_rate * local;
    }
    double share = fmin(1, most / fmax(sqrt(dot3(own, own)), 1e-9));
    for (int x = 0; x < 3; x++) own[x] *= share;
    next->own_sd[m] = known ? fmax((1 - with->own_rate) * track->own_sd[m], with->skin) : track->own_sd[m];
}

/* Whether too few markers were named of those that cameras should see. */
static int is_poor(const Following *with, const Frame *f) {
    int64_t named = 0, due = 0;
    for (int64_t m = 0; m < f->M; m++) {
        int seen = 0, expected = 0;
        for (int64_t c = 0; c < f->C; c++) {
            seen |= f->slot[c * f->M + m] >= 0;
            expected |= f->visible[c * f->M + m];
        }
        named += seen;
        due += expected;
    }
    if (due < with->min_due) due = with->min_due;
    return (double)named < with->min_named_share * (double)due;
}

/* Names a frame by what was fitted to it and learns from the names. `next` gets a track's numbers and the
 * noise in px; returns whether too little was named. */
KERNEL int follow_name(const Following *with, const Frame *frame, double pixel, double *block, const int64_t *unseen,
                       double *fit, double *next, int64_t *unseen_next) {
    const Model *model = with->model;
    Numbers track = numbers_in(model, block), after = numbers_in(model, next);
    Fitted fitted = fitted_in(model, fit);
    RuleArrays rules = *with->rules;
    Frame named = *frame;
    rules.pixel = pixel;
    named.rules = &rules;
    named.points = fitted.points;
    named.covariance = fitted.covariance;
    name_markers(&named, 0);
    memcpy(after.row, fitted.row, (size_t)row_length(model) * sizeof(double));
    difference(model, fitted.row, track.row, after.velocity);
    for (int x = 6; x < PLACEMENT; x++) after.velocity[x] = 0;
    for (int64_t p = 0; p < parameters(model); p++)
        after.velocity[p] = (1 - with->velocity_rate) * track.velocity[p] + with->velocity_rate * after.velocity[p];
    for (int64_t m = 0; m < model->markers; m++) {
        const double *found = named.met + 3 * m;
        int seen = isfinite(found[0]);
        unseen_next[m] = seen ? 0 : unseen[m] + 1;
        learn_own(with, &fitted, &track, m, found, &after);
        for (int64_t i = 3 * m; i < 3 * m + 3; i++)
            after.lag[i] = seen ? (1 - with->own_rate) * (found[i - 3 * m] - fitted.markers[i]) : with->lag_kept * track.lag[i];
    }
    double noise = pixel_noise(with, &named), *learned = after.lag + 3 * model->markers;
    *learned = pixel;
    if (isfinite(noise))
        *learned = clamp((1 - with->noise_rate) * pixel + with->noise_rate * noise, with->min_noise, with->max_noise);
    return is_poor(with, &named);
}
