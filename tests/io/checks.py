# SPDX-License-Identifier: GPL-3.0-or-later
"""What is asked of every reader: that it gives back what was written, refuses in a sentence, and fills no memory."""

import tracemalloc
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import fields, is_dataclass
from pathlib import Path

import numpy as np
import pytest

from addon.core.data.errors import InputError


def refused(words: str, read: Callable, *given, line: int | None = None, file: Path | None = None, **how):
    """Asserts that what is given is refused in one sentence with these words, which names the file and its line.

    `file` is the one that is named, where it is neither what is given nor a file in that folder.
    """
    with pytest.raises(InputError, match=words) as caught:
        read(*given, **how)
    sentence = caught.value.message
    assert "; expected " in sentence and sentence.isprintable()
    if isinstance(given[0], Path):
        named = Path(caught.value.file)
        assert named == file if file else given[0] in (named, named.parent)
    assert line is None or caught.value.line == line


def assert_alike(found: object, wanted: object, where: str = ""):
    """Asserts that two dataclasses, and all that is in them, are alike, numbers to six digits."""
    if is_dataclass(wanted):
        for name in (field.name for field in fields(wanted)):
            assert_alike(getattr(found, name), getattr(wanted, name), f"{where}.{name}")
    elif isinstance(wanted, tuple) and any(map(is_dataclass, wanted)):
        for one, other in zip(found, wanted, strict=True):
            assert_alike(one, other, where)
    elif isinstance(wanted, (np.ndarray, float)):
        np.testing.assert_allclose(found, wanted, rtol=1e-5, atol=1e-12, err_msg=where)
    else:
        assert found == wanted, where


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
