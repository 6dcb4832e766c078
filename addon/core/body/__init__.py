# SPDX-License-Identifier: GPL-3.0-or-later
"""The body: posing it, what hides behind it, what is known of people's bodies before a take is seen."""
