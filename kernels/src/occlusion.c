/* SPDX-License-Identifier: GPL-3.0-or-later */
/* Which markers capsules hide from cameras: `addon/core/papers/virtual_occlusions/occlusion.py`. */

#include <math.h>

#include "kernels.h"
#include "small.h"

#define TINIEST 1e-12
#define ROOM 1.000001 /* for rounding, in what is taken to be out of the way */

/* Squared distance between the line from a point to an eye and an axis; all relative to the axis' start. */
static double segment_distance2(const double *axis, double length2, const double *point, const double *eye) {
    double ray[3] = {eye[0] - point[0], eye[1] - point[1], eye[2] - point[2]};
    double gap2 = dot3(point, point), gap_axis = dot3(point, axis), ray2 = fmax(dot3(ray, ray), TINIEST);
    double ray_gap = dot3(ray, point), ray_axis = dot3(ray, axis);
    double cross = fmax(ray2 * length2 - ray_axis * ray_axis, TINIEST * TINIEST);
    double on_ray = clamp((ray_axis * gap_axis - ray_gap * length2) / cross, 0, 1);
    double on_axis = clamp((ray_axis * on_ray + gap_axis) / length2, 0, 1);
    on_ray = clamp((ray_axis * on_axis - ray_gap) / ray2, 0, 1);
    return gap2 + on_ray * (on_ray * ray2 + 2 * (ray_gap - on_axis * ray_axis)) +
           on_axis * (on_axis * length2 - 2 * gap_axis);
}

/* Whether the line from a point to an eye passes by the sphere around a whole capsule, as it mostly does. */
static int passes_by(const double *middle, double reach2, const double *point, const double *eye) {
    double away[3] = {middle[0] - point[0], middle[1] - point[1], middle[2] - point[2]};
    double ray[3] = {eye[0] - point[0], eye[1] - point[1], eye[2] - point[2]};
    double beyond = dot3(away, away) - reach2, ahead = dot3(away, ray);
    return beyond > 0 && (ahead <= 0 || beyond * dot3(ray, ray) > ahead * ahead * ROOM);
}

/* Capsules start, axis (B, K, 3) and radius (B, K), markers (B, M, 3), centres (C, 3), standoff (B,); hidden (B, C, M). */
KERNEL void capsules_hide(int64_t count, int64_t K, int64_t M, int64_t C, const double *start, const double *axis,
                          const double *radius, const double *markers, const double *centres, const double *standoff,
                          double min_side_share, uint8_t *hidden) {
    for (int64_t b = 0; b < count; b++)
        for (int64_t m = 0; m < M; m++) {
            const double *marker = markers + (b * M + m) * 3;
            uint8_t *out = hidden + b * C * M + m;
            for (int64_t c = 0; c < C; c++) out[c * M] = 0;
            for (int64_t k = 0; k < K; k++) {
                const double *from = start + (b * K + k) * 3, *along = axis + (b * K + k) * 3;
                double size = radius[b * K + k], length2 = fmax(dot3(along, along), TINIEST);
                double point[3] = {marker[0] - from[0], marker[1] - from[1], marker[2] - from[2]};
                double share = clamp(dot3(point, along) / length2, 0, 1), outward[3];
                for (int x = 0; x < 3; x++) outward[x] = point[x] - share * along[x];
                double distance = sqrt(dot3(outward, outward));
                if (!(distance > min_side_share * size)) continue;
                double middle[3] = {along[0] / 2, along[1] / 2, along[2] / 2}, reach = (sqrt(length2) / 2 + size) * ROOM;
                double missing = fmax(size + standoff[b] - distance, 0) / fmax(distance, TINIEST);
                for (int x = 0; x < 3; x++) point[x] += outward[x] * missing;
                for (int64_t c = 0; c < C; c++) {
                    if (out[c * M]) continue;
                    const double *centre = centres + 3 * c;
                    double eye[3] = {centre[0] - from[0], centre[1] - from[1], centre[2] - from[2]};
                    if (passes_by(middle, reach * reach, point, eye)) continue;
                    out[c * M] = segment_distance2(along, length2, point, eye) < size * size;
                }
            }
        }
}
