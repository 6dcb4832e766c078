# SPDX-License-Identifier: GPL-3.0-or-later
"""Pictures for the documentation; needs matplotlib, which nothing else does."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path


@contextmanager
def saved(path: Path, panels: tuple[int, int], inches: tuple[float, float]) -> Iterator:
    """Axes in `panels` rows and columns, flat, to be drawn on; the picture is written when the context ends."""
    import matplotlib as mpl

    mpl.use("Agg")
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(*panels, figsize=inches, squeeze=False)
    yield list(axes.flat)
    for axis in axes.flat:
        axis.grid(alpha=0.3)
    figure.tight_layout()
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=100, metadata={"Software": None})
    plt.close(figure)
