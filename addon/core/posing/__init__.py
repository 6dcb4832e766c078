# SPDX-License-Identifier: GPL-3.0-or-later
"""A body posed on named points, and as the skeleton of a character."""
