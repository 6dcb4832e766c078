# SPDX-License-Identifier: GPL-3.0-or-later
"""A take solved as a whole: what is sure in some frames names the rest, through the body that the take itself shows."""
