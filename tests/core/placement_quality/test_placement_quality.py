# SPDX-License-Identifier: GPL-3.0-or-later
"""Which markers are taken for each other: symmetric sets against others, the algebra, and whether advice helps."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from addon.core.data.errors import InputError
from addon.core.data.markersets import Capsules, MarkerSet, Skeleton, Spread
from addon.core.placement_quality import advise, judge, marker_layout, separation
from addon.core.placement_quality.judging import OTHER_SIDE, Renaming
from addon.core.placement_quality.layout import MarkerLayout
from addon.core.points.likelihood.shape import Latent, Shape
from tests.core.toybody import toy_markerset

SQUARE = np.array([[0.2, 0.2, 0], [-0.2, 0.2, 0], [-0.2, -0.2, 0], [0.2, -0.2, 0]])
KITE = np.array([[0.3, 0.1, 0], [-0.1, 0.25, 0.05], [-0.2, -0.1, 0.1], [0.05, -0.3, -0.1]])


def prop(places: np.ndarray) -> MarkerSet:
    """A stiff thing with markers on it."""
    count = len(places)
    return MarkerSet(
        name="prop",
        description="",
        markers=tuple(f"P{number}" for number in range(count)),
        aliases={},
        skeleton=Skeleton(("prop",), np.array([-1]), np.array([[0.0, 0.0, 0.5]])),
        attachment=np.zeros(count, dtype=int),
        offsets=places,
        capsules=Capsules(np.zeros(0, dtype=int), np.zeros((0, 3)), np.zeros((0, 3)), np.zeros(0)),
        spread=Spread(1.0, 0.02, np.zeros((0, 1 + count, 3)), np.full(count, 0.01), np.zeros((1, 3)), np.zeros((3, 3))),
        source={},
    )


def layout_of(shape: Shape) -> MarkerLayout:
    """That of a thing that has as many markers."""
    return replace(marker_layout(prop(shape.mean)), shape=shape)


def test_a_kite_is_good_and_a_square_is_bad_the_same_from_four_sides_where_it_is_exact():
    square, kite = judge(marker_layout(prop(SQUARE))), judge(marker_layout(prop(KITE)))
    assert separation(square.overlaps.max()) < 1.5
    assert separation(square.seen[square.worst()[0]]) < 1
    assert separation(kite.overlaps.max()) > 5
    assert separation(kite.seen[kite.worst()[0]]) > 5
    assert square.total > 3 * kite.total
    exact = judge(layout_of(Shape(SQUARE, np.zeros((4, 3, 1)), np.full(4, 1e-4))))
    assert sorted(renaming.yaw for renaming in exact.whole) == pytest.approx([np.pi / 2, np.pi, 3 * np.pi / 2])
    np.testing.assert_allclose(exact.overlaps, 1, atol=1e-9)
    assert separation(exact.seen)[0, 1] == pytest.approx(0, abs=1e-3)


def test_an_exchange_is_as_ambiguous_as_gaussians_with_it_made_overlap():
    generator = np.random.default_rng(0)
    mean = generator.standard_normal((7, 3)) * [0.1, 0.1, 0.2]
    shape = Shape(mean, 0.04 * generator.standard_normal((7, 3, 3)), generator.uniform(2e-4, 8e-4, 7))
    stiff = replace(shape, modes=np.zeros((7, 3, 1)))
    order = np.arange(7)
    order[[1, 4]] = 4, 1
    flat = Latent(stiff).flat
    covariance = flat @ flat.T + np.diag(np.repeat(stiff.noise, 3))
    away = (stiff.mean[order] - stiff.mean).ravel()
    expected = np.exp(-away @ np.linalg.solve(covariance, away) / 8)
    for layout, overlap in ((layout_of(stiff), expected), (layout_of(shape), None)):
        pair = judge(layout, []).seen[1, 4]
        [whole] = judge(layout, [Renaming(OTHER_SIDE, order, 0.0)]).overlaps
        assert pair == pytest.approx(whole, rel=0.05)
        assert overlap is None or pair == pytest.approx(overlap, rel=0.05)


def test_an_edited_set_keeps_what_was_learned_of_its_base():
    toy = toy_markerset()
    drawn = marker_layout(toy, seed=4)
    learned = SimpleNamespace(markers=toy.markers, shape=drawn.shape, subjects=3)
    offsets = toy.offsets.copy()
    offsets[3] += [0.0, 0.02, 0.0]
    keep = [0, *range(2, len(toy))]
    edited = replace(
        toy,
        markers=(*(toy.markers[index] for index in keep), "EXTRA"),
        attachment=np.append(toy.attachment[keep], toy.attachment[5]),
        offsets=np.concatenate([offsets[keep], toy.offsets[[5]] + 0.01]),
        spread=replace(
            toy.spread, modes=np.zeros((0, len(toy.skeleton) + len(toy), 3)), marker_sd=np.full(len(toy), 0.004)
        ),
    )
    found = marker_layout(edited, toy, learned)
    assert found.markerset is edited
    np.testing.assert_allclose(found.shape.mean[0], drawn.shape.mean[0])
    assert np.linalg.norm(found.shape.mean[2] - drawn.shape.mean[3]) == pytest.approx(0.034, rel=0.1)
    assert np.linalg.norm(found.shape.mean[-1] - drawn.shape.mean[5]) == pytest.approx(0.017 * 3**0.5, rel=0.1)


def test_advice_makes_the_worst_pair_clearer_and_nothing_worse():
    """Where the thigh's marker sits too near to the knee's."""
    toy = toy_markerset()
    toy.offsets[toy.index("LTHI")] = [0.0, 0.047, -0.22]
    crowded = marker_layout(toy)
    before = judge(crowded)
    assert {before.markers[index] for index in before.worst()[0]} == {"LTHI", "LKNE"}
    [(advice, after)] = advise(crowded, goal=5, steps=1, keep=["LKNE"])
    assert advice.marker == "LTHI"
    assert advice.after > advice.before + 1
    assert "move LTHI on thigh.L by" in advice.in_words(crowded.markerset)
    assert 0.009 < np.linalg.norm(advice.shift(crowded.markerset)) < 0.061
    assert judge(after).total < before.total


def test_a_good_set_needs_no_advice_and_two_markers_are_too_few():
    assert list(advise(marker_layout(prop(KITE)), goal=0.5)) == []
    with pytest.raises(InputError, match="2 markers; expected 3 or more"):
        marker_layout(prop(SQUARE[:2]))
