# SPDX-License-Identifier: GPL-3.0-or-later
"""Labels against the truth."""
