# SPDX-License-Identifier: GPL-3.0-or-later
"""The calibration refined by what a take shows."""
