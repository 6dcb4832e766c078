# SPDX-License-Identifier: GPL-3.0-or-later
"""What was learned for naming points, written and read again, and what is said of a file that is not as expected."""

import json

import numpy as np
import pytest

from addon.core.data.errors import InputError
from addon.core.points.likelihood.learn import learn_likelihood
from addon.io.markersets import Reader
from addon.io.models import likelihood_document, read_likelihood

NAMES = tuple("abcdefgh")


def learned(rigid: bool):
    rng = np.random.default_rng(0)
    base = rng.normal(size=(8, 3))
    noise, way = (0.001, np.linspace(0, 1, 120)) if rigid else (0.03, np.zeros(120))
    takes = [(base * size + way[:, None, None] + noise * rng.normal(size=(120, 8, 3)), str(size)) for size in (1, 1.02)]
    return learn_likelihood(takes[:1] if rigid else takes, NAMES)


@pytest.mark.parametrize("rigid", [True, False])
def test_reading_and_writing_again_changes_nothing(rigid):
    likelihood = learned(rigid)
    assert (likelihood.rigid_bodies is not None) == rigid
    document = likelihood_document(likelihood)
    again = read_likelihood(Reader("model"), json.loads(json.dumps(document)), NAMES)
    assert likelihood_document(again) == document
    assert np.allclose(again.shape.modes, likelihood.shape.modes, rtol=1e-5, atol=1e-12)
    assert np.allclose(again.calibration.least, likelihood.calibration.least, rtol=1e-5)


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("mean", [[0, 0, 0]]),
        ("noise", [0.1] * 7 + [-1]),
        ("modes", [[1, 2]]),
        ("ties", [[0, 99, 0.1, 0.1]]),
        ("rates", [1.0, "all"]),
        ("least", [[1.0]]),
        ("subjects", "two"),
        ("plates", [[0, 0, 1]]),
    ],
)
def test_a_part_that_is_not_as_expected_is_named(key, value):
    document = likelihood_document(learned(True))
    document[key] = value
    with pytest.raises(InputError, match=key):
        read_likelihood(Reader("model"), document, NAMES)
