# SPDX-License-Identifier: GPL-3.0-or-later
"""The partial-solvers paper's evaluation, its method and ours side by side: see `__main__`."""
