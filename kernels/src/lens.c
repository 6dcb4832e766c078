/* SPDX-License-Identifier: GPL-3.0-or-later */
/* Taking a lens out of images: `straightened` in `addon/core/geometry/cameras.py`. */

#include <math.h>

#include "kernels.h"

/* Where a lens k1 k2 p1 p2 k3 moves a point, less where it was seen; and the derivative, which is symmetric. */
static void moved_by(const double *lens, const double *point, const double *seen, double error[2], double slope[3]) {
    double x = point[0], y = point[1], r2 = x * x + y * y, k1 = lens[0], k2 = lens[1], p1 = lens[2], p2 = lens[3], k3 = lens[4];
    double radial = 1 + r2 * (k1 + r2 * (k2 + r2 * k3)), rise = 2 * (k1 + r2 * (2 * k2 + 3 * k3 * r2));
    error[0] = x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x * x) - seen[0];
    error[1] = y * radial + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y - seen[1];
    slope[0] = radial + rise * x * x + 2 * p1 * y + 6 * p2 * x;
    slope[1] = rise * x * y + 2 * p1 * x + 2 * p2 * y;
    slope[2] = radial + rise * y * y + 6 * p1 * y + 2 * p2 * x;
}

static double larger(const double error[2]) { return fmax(fabs(error[0]), fabs(error[1])); }

/* image (N, 2) seen through lenses (N, 5) of some reach (N,); found (N, 2), NaN where no light comes from. */
KERNEL void straightened(int64_t count, const double *image, const double *lens, const double *reach, int64_t max_steps,
                      double tolerance, double max_error, double first_share, double *found) {
    for (int64_t i = 0; i < count; i++) {
        const double *seen = image + 2 * i;
        double radius = sqrt(seen[0] * seen[0] + seen[1] * seen[1]), share = first_share * reach[i] / radius;
        double error[2], slope[3], *point = found + 2 * i;
        if (!(share < 1)) share = 1;
        for (int x = 0; x < 2; x++) point[x] = seen[x] * share;
        moved_by(lens + 5 * i, point, seen, error, slope);
        for (int64_t step = 0; step < max_steps && larger(error) >= tolerance; step++) {
            double det = slope[0] * slope[2] - slope[1] * slope[1];
            point[0] -= (slope[2] * error[0] - slope[1] * error[1]) / det;
            point[1] -= (slope[0] * error[1] - slope[1] * error[0]) / det;
            moved_by(lens + 5 * i, point, seen, error, slope);
        }
        int reached = larger(error) < max_error && point[0] * point[0] + point[1] * point[1] < reach[i] * reach[i];
        if (!(reached && isfinite(error[0]) && isfinite(error[1]))) point[0] = point[1] = NAN;
    }
}
