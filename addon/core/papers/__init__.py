# SPDX-License-Identifier: GPL-3.0-or-later
"""The two papers, each in its own order and words; what the program does beyond them lives elsewhere and calls them."""
