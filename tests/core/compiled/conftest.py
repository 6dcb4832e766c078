# SPDX-License-Identifier: GPL-3.0-or-later
"""The compiled library, where there is one, and everything done without it."""

import sys
from collections.abc import Iterator
from contextlib import contextmanager

import pytest

from addon.core.kernels import in_use


@pytest.fixture(autouse=True, scope="session")
def library():
    """Skips what compares, where there is nothing to compare."""
    if not in_use():
        pytest.skip("the compiled library is not in use: `kernels/build_kernels.py --install` brings it")


@contextmanager
def numpy_everywhere() -> Iterator[None]:
    """A context in which NumPy does everything, as without a library."""
    with pytest.MonkeyPatch.context() as patch:
        for name in [name for name in sys.modules if name.startswith("addon.core.")]:
            for attribute, value in list(vars(sys.modules[name]).items()):
                if attribute == "in_use":
                    patch.setattr(sys.modules[name], attribute, lambda: False)
                elif hasattr(value, "reference") and hasattr(value, "kernel"):
                    patch.setattr(sys.modules[name], attribute, value.reference)
        yield
