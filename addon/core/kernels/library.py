# SPDX-License-Identifier: GPL-3.0-or-later
"""Finds the compiled library for this machine and lets its functions stand for those of NumPy.

It comes as a package of its own, `mocap_autolabel_kernels`, which a wheel brings. Where there is none that fits, or
MOCAP_AUTOLABEL_NUMPY=1 asks for it, NumPy does the work.
"""

import ctypes
import importlib
import os
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

LIBRARY_PACKAGE = "mocap_autolabel_kernels"
SWITCH = "MOCAP_AUTOLABEL_NUMPY"
LIBRARY_VERSION = 7  # of what the functions take, as in kernels.h; a library of another is not used


def _loaded() -> ctypes.CDLL | None:
    if os.environ.get(SWITCH, "0") not in ("", "0"):
        return None
    # After an update in a running Blender the package of the version before is still imported, and its library gone.
    sys.modules.pop(LIBRARY_PACKAGE, None)
    importlib.invalidate_caches()
    try:
        library = ctypes.CDLL(str(Path(importlib.import_module(LIBRARY_PACKAGE).PATH)))
        library.version.restype = ctypes.c_int
    except (ImportError, OSError, AttributeError):
        return None
    return library if library.version() == LIBRARY_VERSION else None


compiled: Any = _loaded()  # its functions have the names and arguments of kernels.h


def in_use() -> bool:
    """Whether the compiled functions do the work."""
    return compiled is not None


def stands_for(kernel: Callable) -> Callable[[Callable], Callable]:
    """Puts `kernel` in the place of the NumPy function it decorates, which stays at hand as its `reference`."""

    def choose(reference: Callable) -> Callable:
        chosen = reference if compiled is None else kernel
        vars(chosen).update(reference=reference, kernel=kernel)
        return chosen

    return choose
