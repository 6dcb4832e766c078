# SPDX-License-Identifier: GPL-3.0-or-later
"""A marker set in words on a body that is known."""

from dataclasses import replace

import numpy as np
import pytest

from addon.core.data.errors import InputError
from addon.core.data.layouts import Layout, Site
from addon.core.training.described import DESCRIBING, described
from addon.io.layouts import open_layout, shipped_layouts
from addon.io.markersets import open_markerset
from addon.jobs.models import known_bodies


@pytest.fixture(scope="module")
def bodies():
    return known_bodies()


def one(bodies, **words) -> np.ndarray:
    """(3,) where a marker in words is in the rest pose, heights."""
    return described(Layout("a", "", "", {"A": Site(**words)}), bodies).rest_markers[0]


@pytest.mark.parametrize("name", shipped_layouts())
def test_every_published_layout_is_a_marker_set(name, bodies):
    layout = open_layout(name)
    markerset = described(layout, bodies)
    assert layout.name == name and layout.source
    assert f"{len(markerset)} markers" in layout.description
    at = markerset.rest_markers
    apart = np.linalg.norm(at[:, None] - at, axis=2) + np.eye(len(at))
    assert apart.min() > 0.01  # heights: no two of them are in one place
    assert (at[:, 2] > 0).all() and (at[:, 2] < 1.05).all()


def test_landmarks_and_places_between_beside_and_along_them_are_where_the_body_has_them(bodies):
    usual, found = open_markerset("body39"), described(open_layout("plugin_gait"), bodies)
    for name in usual.markers:
        np.testing.assert_allclose(found.offsets[found.index(name)], usual.offsets[usual.index(name)], atol=1e-9)
    for name in shipped_layouts():
        markerset = described(open_layout(name), bodies)
        for index, marker in enumerate(markerset.markers):
            for left, right in (("L", "R"), ("Left", "Right")):
                other = marker.replace(left, right)
                if other != marker and other in markerset.markers and marker != "CLAV":
                    mirrored = markerset.rest_markers[markerset.index(other)] * [1, -1, 1]
                    np.testing.assert_allclose(markerset.rest_markers[index], mirrored, atol=2e-3)
    lateral, medial = (one(bodies, segment="thigh.L", place=f"{side} epicondyle") for side in ("lateral", "medial"))
    assert lateral[1] > medial[1] > 0
    assert abs(lateral[2] - medial[2]) < 0.02
    high, low = (one(bodies, segment="thigh.R", place="front", along=along) for along in (0.2, 0.8))
    body = min(bodies, key=lambda body: len(body.skeleton))
    hip = body.skeleton.rest_joints[body.skeleton.segments.index("thigh.R")]
    assert high[2] > low[2] and high[0] > hip[0] and low[1] < 0
    words = {"segment": "shank.L", "place": "outer", "along": 0.5}
    skin, wand = one(bodies, **words), one(bodies, **words, off_m=0.08)
    height = described(Layout("a", "", "", {"A": Site(**words)}), bodies).spread.height
    assert np.linalg.norm(wand - skin) * height == pytest.approx(0.08)
    assert wand[1] > skin[1]
    sites = {"A": Site("thigh.L", "lateral epicondyle"), "B": Site("thigh.L", "outer", 0.5)}
    sd = described(Layout("a", "", "", sites), bodies).spread.marker_sd
    assert sd[0] < sd[1] == DESCRIBING.anywhere_sd


@pytest.mark.parametrize(
    ("site", "words"),
    [
        (Site("tail", "tip"), "A is on 'tail', which is no segment; expected one of pelvis, thorax"),
        (Site("thigh.L", "kneecap"), "A is at 'kneecap', which is no place of thigh.L; expected one of outside"),
        (Site("thigh.L", "front"), "which is no place of thigh.L"),
        (Site("thigh.L", "outside", 0.5), "which is no place of thigh.L"),
        (Site("pelvis", "ASIS"), "A is at 'ASIS', which is on both sides; expected left or right before it"),
    ],
)
def test_an_unknown_word_is_said(site, words, bodies):
    with pytest.raises(InputError, match=words):
        described(Layout("a", "", "", {"A": site}), bodies)


def test_it_stands_on_the_lower_body_where_that_is_enough(bodies):
    legs = described(open_layout("helen_hayes"), bodies)
    assert legs.skeleton.segments == open_markerset("gait15").skeleton.segments
    layout = open_layout("helen_hayes")
    more = replace(layout, sites=layout.sites | {"C7": Site("thorax", "C7")})
    assert "head" in described(more, bodies).skeleton.segments
