# SPDX-License-Identifier: GPL-3.0-or-later
"""What is asked of every reader: that it refuses in one sentence, and fills no memory."""

import tracemalloc
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from addon.core.data.errors import InputError


def refused(words: str, read: Callable, *given, line: int | None = None, **how):
    """Asserts that what is given is refused in one sentence with these words, which names the file and its line."""
    with pytest.raises(InputError, match=words) as caught:
        read(*given, **how)
    sentence = caught.value.message
    assert "; expected " in sentence and sentence.isprintable()
    if isinstance(given[0], Path):
        assert Path(caught.value.file).parent in (given[0], given[0].parent)
    assert line is None or caught.value.line == line


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
