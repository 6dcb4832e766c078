# SPDX-License-Identifier: GPL-3.0-or-later
"""Cameras with another's name, or moved, are told by name; of cameras that go together nothing is said."""

import csv
from dataclasses import replace
from itertools import islice
from types import SimpleNamespace

import numpy as np
import pytest

from addon.core.data.takes import NO_MARKER, Blobs
from addon.core.geometry.cameras import Cameras
from addon.core.geometry.rotations import turn_of
from addon.core.review.odd_cameras import CameraCheck, _renamed
from addon.core.review.suspects import cameras_in
from addon.core.simulation.rigs import ring_rig
from addon.core.simulation.simulate import disturbed
from addon.io.blobs import read_blobs
from addon.io.cameras import read_cameras
from addon.io.points import read_points
from tests.core.scenes import keep

FRAMES, MARKERS = 60, 30
OTHERS, FIT = "cameras seem to have the names of others: the blobs of", " fit the calibration of"
ALL_ON = [f"cam{one}{FIT} cam{other}" for one, other in zip((1, *range(8, 1, -1)), range(8, 0, -1), strict=True)]
RIG = ring_rig(8, generator=np.random.default_rng(5))


def captured(true: Cameras, seed: int = 0, seen: float = 0.7, noise: float = 0.3):
    """Blobs of markers on somebody who walks past `true`, some hidden, ghosts among them; markers and their truth."""
    random = np.random.default_rng(seed)
    body = random.uniform([-0.3, -0.3, 0.05], [0.3, 0.3, 1.7], (MARKERS, 3))
    way = np.linspace([-0.5, -0.3, 0], [0.5, 0.3, 0], FRAMES)[:, None]
    markers = body + way + 0.03 * random.standard_normal((FRAMES, MARKERS, 3))
    pixels = np.moveaxis(true.project(markers), 0, 1)
    there = (random.random(pixels.shape[:3]) < seen) & ((pixels > 0) & (pixels < true.size[:, None])).all(axis=3)
    frame, camera, marker = np.nonzero(there)
    xy = pixels[there] + noise * random.standard_normal((len(frame), 2))
    ghosts = FRAMES * len(true) * 4
    frame = np.append(frame, random.integers(0, FRAMES, ghosts))
    camera = np.append(camera, random.integers(0, len(true), ghosts))
    xy = np.concatenate([xy, random.uniform(0, 1, (ghosts, 2)) * true.size[camera[-ghosts:]]])
    marker = np.append(marker, np.full(ghosts, NO_MARKER))
    order = np.argsort(frame, kind="stable")
    blobs = Blobs(np.arange(FRAMES) + 11, frame[order], camera[order], xy[order], np.full(len(frame), np.nan))
    return blobs, marker[order], markers


def said(cameras: Cameras, blobs: Blobs, marker: np.ndarray, expected: np.ndarray) -> list[str]:
    """What is said of a take that is added in chunks of ten frames."""
    check = CameraCheck(cameras)
    for first in range(0, FRAMES, 10):
        rows = (blobs.frame >= first) & (blobs.frame < first + 10)
        part = blobs.between(first + 11, first + 20)
        check.add(part, marker[rows], expected[first : first + 10])
    suspects = check.suspects()
    assert all((suspect.first, suspect.last) == (11, 10 + FRAMES) for suspect in suspects)
    return [suspect.reason for suspect in suspects]


def turned(cameras: Cameras, *which: tuple[int, np.ndarray]) -> Cameras:
    """The cameras, some of them turned where they stand by a rotation vector."""
    rotation = cameras.rotation.copy()
    for index, vector in which:
        rotation[index] = turn_of(np.asarray(vector, float)) @ rotation[index]
    return replace(cameras, rotation=rotation, translation=-np.einsum("cij,cj->ci", rotation, cameras.centres))


def under(blobs: Blobs, names: dict[int, int]) -> Blobs:
    """The blobs of camera k under the name of camera `names[k]`."""
    new = np.arange(len(RIG))
    new[list(names)] = list(names.values())
    return replace(blobs, camera=new[blobs.camera])


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("seen", [0.9, 0.4])
def test_nothing_is_said_of_cameras_that_go_together(seed, seen):
    blobs, marker, markers = captured(RIG, seed, seen)
    assert said(RIG, blobs, marker, markers) == []
    nowhere = np.full_like(markers, np.nan)
    assert said(RIG, blobs, np.full_like(marker, NO_MARKER), nowhere) == []


@pytest.mark.parametrize(
    ("names", "words"),
    [
        ({2: 4, 4: 2}, ["cameras cam3 and cam5 seem to have each other's names: exchanged, their blobs fit"]),
        (
            {0: 1, 1: 0, 6: 7, 7: 6},
            [
                "cameras cam1 and cam2 seem to have each other's names: exchanged, their blobs fit",
                "cameras cam7 and cam8 seem to have each other's names: exchanged, their blobs fit",
            ],
        ),
        ({1: 3, 3: 5, 5: 1}, [f"{OTHERS} cam2{FIT} cam6, those of cam6{FIT} cam4, those of cam4{FIT} cam2"]),
        ({index: (index + 1) % 8 for index in range(8)}, [f"{OTHERS} {', those of '.join(ALL_ON)}"]),
    ],
)
@pytest.mark.parametrize("recognised", [True, False])
def test_names_that_were_exchanged(names, words, recognised):
    """Whether somebody was recognised by the other cameras or nobody was at all."""
    blobs, marker, markers = captured(RIG)
    marker = np.where(np.isin(blobs.camera, list(names)) | (not recognised), NO_MARKER, marker)
    found = said(RIG, under(blobs, names), marker, markers if recognised else np.full_like(markers, np.nan))
    assert found == words


@pytest.mark.parametrize("which", [[3], [3, 6]])
def test_cameras_that_were_moved_are_named_with_how_far(which):
    angles = (0.004, 0.002)
    moved = turned(RIG, *((index, [angle, 0, 0]) for index, angle in zip(which, angles, strict=False)))
    blobs, marker, markers = captured(moved)
    words = said(RIG, blobs, marker, markers)
    assert len(words) == len(which)
    for index, angle, sentence in zip(which, angles, words, strict=False):
        assert sentence.startswith(f"camera cam{index + 1} seems to have moved since the calibration: its blobs are ")
        pixels = float(sentence.split(" are ")[1].split(" px")[0])
        assert pixels == pytest.approx(angle * RIG.focal[index], rel=0.25)


@pytest.mark.parametrize("count", [4, 6])
def test_a_calibration_that_is_a_little_off_everywhere_has_no_camera_that_moved(count):
    for seed in range(4):
        rig = ring_rig(count, generator=np.random.default_rng(seed))
        blobs, marker, markers = captured(disturbed(rig, 1.0, 0.5, np.random.default_rng(seed)), seed)
        assert said(rig, blobs, marker, markers) == []


@pytest.mark.parametrize("count", [4, 5, 7])
def test_of_few_cameras_the_one_that_moved_is_told(count):
    """Turned by half a degree, which leaves the blobs their names, and by two, which does not."""
    rig = ring_rig(count, generator=np.random.default_rng(count))
    for degrees, named, way in ((0.3, True, "px off the points"), (2.0, False, "its blobs fit with it turned by 2.0°")):
        blobs, marker, markers = captured(turned(rig, (1, np.radians(degrees) * np.array([0.6, -0.64, 0.48]))), count)
        words = said(rig, blobs, np.where((blobs.camera == 1) & (not named), NO_MARKER, marker), markers)
        assert len(words) == 1
        assert words[0].startswith("camera cam2 seems to have moved since the calibration")
        assert way in words[0]


@pytest.mark.parametrize("count", [2, 5])
@pytest.mark.parametrize("named", [True, False])
def test_a_room_that_is_not_this_takes_is_told_once(count, named):
    """Whether the labelling saw somebody in it all the same, or nobody."""
    rig = ring_rig(count, generator=np.random.default_rng(1))
    blobs, marker, markers = captured(ring_rig(count, radius=5.0, generator=np.random.default_rng(9)))
    words = said(rig, blobs, np.where(named, marker, NO_MARKER), markers if named else np.full_like(markers, np.nan))
    assert len(words) == 1
    assert words[0].startswith("the room seems not to be this take's: by this calibration the blobs of no camera meet")


class ListedMarkers(list):
    """As much of a marker set as its size needs."""

    rest_markers = np.random.default_rng(3).uniform([-0.15, -0.15, 0.03], [0.15, 0.15, 1], (MARKERS, 3))
    spread = SimpleNamespace(height=1.7)


@pytest.mark.parametrize("count", [2, 4])
@pytest.mark.parametrize(
    ("times", "words"),
    [
        (1000, "about 1000 times too large, as if millimetres were read as metres: what its cameras see is "),
        (100, "about 100 times too large, as if centimetres were read as metres: what its cameras see is "),
        (10, "about 10 times too large: what its cameras see is "),
        (1, ""),
        (0.001, "about 1000 times too small: what its cameras see is "),
    ],
)
def test_a_room_in_the_wrong_unit_is_told_with_how_much(count, times, words):
    rig = ring_rig(count, generator=np.random.default_rng(count))
    blobs, marker, markers = captured(rig)
    room = replace(rig, translation=times * rig.translation)
    check = CameraCheck(room, ListedMarkers([None] * MARKERS))
    check.add(blobs, np.full_like(marker, NO_MARKER), np.full_like(markers, np.nan))
    told = [suspect.reason for suspect in check.suspects()]
    assert len(told) == bool(words)
    for sentence in told:
        assert words in sentence and "; expected the calibration that the take was recorded with, in metres" in sentence
        assert float(sentence.split("cameras see is ")[1].split(" m high")[0]) == pytest.approx(1.3 * times, rel=0.2)


@pytest.mark.parametrize("others", [0, 1])
def test_one_camera_alone_has_blobs_only_where_no_frame_at_all_has_one_of_another(others):
    blobs, marker, markers = captured(RIG)
    alone = blobs.camera == 0
    also = np.flatnonzero((blobs.camera == 1) & (blobs.frame == 1))[:others]
    check = CameraCheck(RIG)
    for rows in (np.sort([*np.flatnonzero(alone), *also]), *2 * [np.flatnonzero(alone)]):
        part = Blobs(blobs.frames, blobs.frame[rows], blobs.camera[rows], blobs.xy[rows], blobs.area[rows])
        check.add(part, marker[rows], markers)
    assert not any((camera == 1).any() for camera, *_ in check.frames), "that frame is not among those that are kept"
    told = [suspect.reason for suspect in check.suspects()]
    assert any(reason.startswith("camera cam1 alone has blobs") for reason in told) == (not others)


def test_the_cameras_that_were_really_moved(shared_data):
    """The Qualisys take's cameras 15343 and 15344; named by its own 3D, not by a model."""
    folder = shared_data / "blobs" / "qualisys_run"
    cameras, take = read_cameras(folder / "room.toml"), read_points(folder / "run.c3d")
    with (folder / "run.truth.csv").open(newline="") as file:
        names = [row["marker"].partition("|")[0] for row in islice(csv.DictReader(file), 110_000)]
    truth = np.array([take.names.index(name) if name in take.names else NO_MARKER for name in names])
    check, at = CameraCheck(cameras), 0
    for part in read_blobs(folder / "run.csv", cameras, (1, 400)):
        marker = truth[at : at + len(part.blobs)]
        at += len(marker)
        check.add(part.blobs, marker, take.xyz[part.blobs.frames - take.first_frame])
    words = [suspect.reason for suspect in check.suspects()]
    assert [sentence.split(" seems")[0] for sentence in words] == ["camera 15343", "camera 15344"]
    assert 1.5 < check.offset[cameras.names.index("15343")] < 3


@pytest.mark.parametrize(
    ("words", "about"),
    [
        ("camera cam12 seems to have moved since the calibration: its blobs fit with it turned by 2.0° and", ["cam12"]),
        ("camera 2 seems to have moved since the calibration: it is turned by 1.0° and shifted by 12 mm", ["2"]),
        ("camera 12 shows almost none of the markers in its image (1% have a blob, with the others 2%)", ["12"]),
        (_renamed(["1", "12"]), ["1", "12"]),
        (_renamed(["cam1", "cam2", "cam12"]), ["cam1", "cam2", "cam12"]),
        ("the room seems to be about 1000 times too large: what its cameras see is 2 m high", []),
        ("cam1 is far from where the body has it", []),
    ],
)
def test_a_sentence_is_about_the_cameras_that_it_names_and_no_others(words, about):
    assert list(cameras_in(words, ["1", "2", "12", "cam1", "cam2", "cam12"])) == about


@pytest.mark.parametrize(("count", "off"), [(4, 3.0), (8, 5.0)])
def test_a_room_whose_blobs_lie_beside_where_they_should_is_told(count, off):
    """Some still meet, and a body is found by whatever is near it."""
    rig = ring_rig(count, generator=np.random.default_rng(2))
    blobs, marker, markers = captured(rig)
    words = said(rig, replace(blobs, xy=blobs.xy + off), marker, markers)
    assert words[0].startswith("the room seems not to be this take's: by this calibration few blobs of one name meet")
    assert words[0].endswith("; expected the calibration that the take was recorded with, in metres")


@pytest.mark.parametrize(("seen", "off", "noise"), [(0.9, (-2, 1), 0.3), (0.4, (-2, 1), 0.3), (0.7, (0, 0), 2.0)])
def test_a_calibration_of_some_age_and_blobs_that_are_off_by_chance_make_no_other_room(seen, off, noise):
    """With noise of 2 px fewer than half of the blobs meet others, and 99.9 % of names are right."""
    blobs, marker, markers = captured(RIG, seen=seen, noise=noise)
    told = said(RIG, replace(blobs, xy=blobs.xy + off), marker, markers)
    assert not [words for words in told if words.startswith("the room")]


def test_cameras_that_saw_nothing_make_no_other_room_and_are_told():
    blobs, marker, markers = captured(RIG)
    rows = blobs.camera < 3
    told = said(RIG, keep(blobs, rows), marker[rows], markers)
    assert len(told) == len(RIG) - 3
    assert all("shows almost none of the markers in its image (0% have a blob" in words for words in told)
