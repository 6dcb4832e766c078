# SPDX-License-Identifier: GPL-3.0-or-later
"""The virtual person in `body26`, and the model that names it."""

import pytest

from addon.demo.take import make_performance
from addon.io.markersets import open_markerset
from addon.io.models import open_model


@pytest.fixture(scope="module")
def model():
    return open_model("body26")


@pytest.fixture(scope="module")
def markers(request):
    """(T, M, 3) m, as many frames as the module says."""
    return make_performance(open_markerset("body26")).take.xyz[: request.module.FRAMES].astype(float)
