# SPDX-License-Identifier: GPL-3.0-or-later
"""What a person should look at, and what a report says of a take."""
