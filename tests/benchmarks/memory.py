# SPDX-License-Identifier: GPL-3.0-or-later
"""What this process holds in memory, as the system says. Linux only."""

from pathlib import Path


def megabytes(key: str) -> float:
    """What the system says of this process under a key, such as its peak since `forget_peak`."""
    lines = Path("/proc/self/status").read_text(encoding="ascii").splitlines()
    return next(int(line.split()[1]) / 1024 for line in lines if line.startswith(key))


def forget_peak():
    """Lets the peak be that of what follows."""
    Path("/proc/self/clear_refs").write_text("5", encoding="ascii")
