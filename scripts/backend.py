# SPDX-License-Identifier: GPL-3.0-or-later
"""What builds the Python package, for pip and its like: setuptools, and a compiler for wheels where there is one."""

import build_kernels
from setuptools import build_meta
from setuptools.build_meta import (
    build_editable,
    build_sdist,
    build_wheel,
    get_requires_for_build_editable,
    get_requires_for_build_sdist,
    prepare_metadata_for_build_editable,
    prepare_metadata_for_build_wheel,
)

__all__ = [
    "build_editable",
    "build_sdist",
    "build_wheel",
    "get_requires_for_build_editable",
    "get_requires_for_build_sdist",
    "get_requires_for_build_wheel",
    "prepare_metadata_for_build_editable",
    "prepare_metadata_for_build_wheel",
]


def get_requires_for_build_wheel(config_settings: dict | None = None) -> list[str]:
    """What has to be installed before a wheel is built: the compiler, on the platforms that a library is built for."""
    compiler = [build_kernels.COMPILER_PACKAGE] if build_kernels.this_platform() in build_kernels.TARGETS else []
    return [*build_meta.get_requires_for_build_wheel(config_settings), *compiler]
