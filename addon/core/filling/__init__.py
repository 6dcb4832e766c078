# SPDX-License-Identifier: GPL-3.0-or-later
"""Gaps of named markers filled by what the rest of the take says, with the error to expect."""
