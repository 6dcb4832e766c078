# SPDX-License-Identifier: GPL-3.0-or-later
"""How much memory a piece of code takes."""

import tracemalloc
from collections.abc import Iterator
from contextlib import contextmanager


@contextmanager
def memory_within(most: float) -> Iterator[None]:
    """Fails where the block takes more bytes than that at a time."""
    tracemalloc.start()
    try:
        yield
        taken = tracemalloc.get_traced_memory()[1]
        assert taken < most, f"{taken / 1e6:.0f} MB"
    finally:
        tracemalloc.stop()
