# SPDX-License-Identifier: GPL-3.0-or-later
"""The body's motion on somebody's own rig."""
