# SPDX-License-Identifier: GPL-3.0-or-later
"""What many tests of the core start from."""

import pytest

from addon.io.markersets import builtin_markersets, open_markerset
from addon.io.models import open_model


@pytest.fixture(scope="session")
def model():
    return open_model("gait15")


@pytest.fixture(scope="session")
def known():
    return [open_markerset(name) for name in builtin_markersets()]
