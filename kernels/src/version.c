/* SPDX-License-Identifier: GPL-3.0-or-later */

#include "kernels.h"

KERNEL int version(void);
KERNEL int version(void) { return KERNELS_VERSION; }
