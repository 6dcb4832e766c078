# SPDX-License-Identifier: GPL-3.0-or-later
"""What motion capture programs send while they record: points, a frame at a time.

Each program's wire is one file; `sources.open_stream` opens one by its address. Nothing here starts a thread or waits
longer than it says.
"""
