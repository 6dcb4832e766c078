# SPDX-License-Identifier: GPL-3.0-or-later
"""Two people in a take of blobs of which one subject was asked: told, and nobody else's take is."""

from dataclasses import replace

import pytest

from addon.core.blobs.pipeline import label_take
from addon.core.data.takes import Blobs
from addon.core.geometry.cameras import Cameras
from addon.core.pipelines.others import MOST_FRAMES, OtherSubjects, refuse_two
from addon.core.points.refusals import SubjectsError
from addon.core.simulation.rigs import ring_rig
from addon.core.simulation.simulate import CaptureOptions
from tests.core.scenes import abreast, cut

FRAMES, RATE, CHUNK = 40, 50.0, 16
QUIET = CaptureOptions(seed=3)


@pytest.fixture(scope="module")
def cameras():
    return ring_rig(8, (1280, 1024), 4.0, 2.2, 1.6)


def blobs_of(model, cameras: Cameras, people: tuple[int, ...], options: CaptureOptions = QUIET) -> Blobs:
    """What cameras see of people, by their seeds, who walk side by side, 0.8 m apart."""
    return abreast(model.markerset, people, FRAMES, RATE, 0.8, cameras, options).blobs


def looked_at(blobs: Blobs, cameras: Cameras, model) -> OtherSubjects:
    """A take that was labelled as one subject's, and looked at."""
    others = OtherSubjects(cameras, model)
    parts = cut(blobs, CHUNK)
    for part, chunk in zip(parts, label_take(parts, cameras, model.markerset, RATE), strict=True):
        others.add(part, chunk)
    return others


def test_two_are_told_before_any_of_the_take_is_named(model, cameras):
    with pytest.raises(SubjectsError, match=r"two subjects or more that wear gait15"):
        refuse_two(lambda: cut(blobs_of(model, cameras, (1, 2)), CHUNK), cameras, model)


@pytest.mark.parametrize(("reflections", "read"), [(2, 1), (30, 2)])
def test_a_take_of_one_is_not_and_read_in_parts_only_unless_it_is_crowded(model, cameras, reflections, read):
    parts, begun = cut(blobs_of(model, cameras, (1,), replace(QUIET, reflections=reflections)), CHUNK), []

    def reading():
        begun.append(1)
        return iter(parts)

    refuse_two(reading, cameras, model)
    assert len(begun) <= read


def test_who_leaves_soon_is_not_told_before(model, cameras):
    both, alone = blobs_of(model, cameras, (1, 2)), blobs_of(model, cameras, (1,))
    early = Blobs.join([both.between(1, 10), alone.between(11, FRAMES)])
    refuse_two(lambda: cut(early, CHUNK), cameras, model)


@pytest.mark.parametrize("reflections", [2, 30])
def test_one_among_ghosts_is_not(model, cameras, reflections):
    others = looked_at(blobs_of(model, cameras, (1,), replace(QUIET, reflections=reflections)), cameras, model)
    assert bool([one for one in others.kept if one is not None]) == (reflections == 30)
    others.refuse()


def test_who_is_beside_for_a_moment_is_not(model, cameras):
    both, alone = blobs_of(model, cameras, (1, 2)), blobs_of(model, cameras, (1,))
    late = Blobs.join([alone.between(1, 30), both.between(31, FRAMES)])
    others = looked_at(late, cameras, model)
    assert any(one is not None for one in others.kept)
    others.refuse()


def test_as_much_is_kept_of_a_take_of_any_length(model, cameras):
    blobs = blobs_of(model, cameras, (1, 2))
    part = blobs.between(1, CHUNK)
    chunk = next(iter(label_take([part], cameras, model.markerset, RATE)))
    others = OtherSubjects(cameras, model)
    for count in range(1, 41):
        others.add(part, chunk)
        assert len(others.kept) <= 2 * MOST_FRAMES
        assert others.frames == count * CHUNK
    assert len(others.kept) > MOST_FRAMES / 2
    assert len(others.kept) == len(others.residual)
