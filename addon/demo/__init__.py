# SPDX-License-Identifier: GPL-3.0-or-later
"""The take that the project makes by itself, and the picture of it."""
