# SPDX-License-Identifier: GPL-3.0-or-later
"""Takes to learn from: whose they are, which markers they share, and every way in which they cannot be used."""

import re
from pathlib import Path

import numpy as np
import pytest

from addon.core.errors import InputError
from addon.core.models import Lessons
from addon.core.takes import Points
from addon.io.points import write_c3d
from addon.jobs.lessons import chosen_markers, gathered, joined, most_different, of_markers, read_takes

NAMES = ("A", "B", "C", "D", "E")


def write(path: Path, names=NAMES, frames: int = 30, size: float = 1.0, seed: int = 0) -> Path:
    """A labelled take of markers that stand around each other and move a little."""
    path.parent.mkdir(exist_ok=True)
    places = np.random.default_rng(1).uniform([-0.4, -0.3, 0.1], [0.4, 0.3, 1.7], (len(names), 3))
    xyz = size * (places + np.random.default_rng(seed).normal(0, 0.02, (frames, len(names), 3)))
    write_c3d(path, Points(tuple(names), xyz, np.zeros(xyz.shape[:2]), 100.0, 1))
    return path


def test_folders_or_patterns_tell_the_subjects(tmp_path):
    paths = [write(tmp_path / "ann" / "1.c3d"), write(tmp_path / "bob" / "1.c3d"), write(tmp_path / "bob" / "2.c3d")]
    assert [take.subject for take in read_takes(paths, ())] == ["ann", "bob", "bob"]
    assert [take.subject for take in read_takes(paths, [("x", "*/bob/*"), ("y", "1.c3d")])] == ["y", "x", "x"]
    assert [take.subject for take in read_takes(paths[1:], ())] == ["bob", "bob"]
    with pytest.raises(InputError, match="no take suits the subject"):
        read_takes(paths, [("x", "*.trc")])


def test_markers_are_those_in_common_or_those_asked_for(tmp_path):
    takes = read_takes(
        [write(tmp_path / "1.c3d", (*NAMES, "X")), write(tmp_path / "2.c3d", ("Ann:Y", *NAMES[::-1]))], ()
    )
    assert chosen_markers(takes, None) == NAMES
    assert chosen_markers(takes, ["B", "C", "X", "A"]) == ("B", "C", "X", "A")
    with pytest.raises(InputError, match="no take has a marker Z"):
        chosen_markers(takes, ["A", "B", "C", "Z"])
    odd = read_takes([write(tmp_path / "3.c3d", (*NAMES, "a,b"))], ())
    with pytest.raises(InputError, match="'a,b', which has a sign that label files need"):
        chosen_markers(odd, None)
    assert chosen_markers(odd, NAMES) == NAMES
    with pytest.raises(InputError, match="too few to be told apart"):
        chosen_markers(takes, ["A", "B"])
    [points] = gathered(takes, ("X", "A", "Y")).values()
    assert points.shape == (60, 3, 3)
    assert np.isfinite(points[:, 1]).all()
    assert np.isnan(points[30:, 0]).all()


def test_a_model_that_is_trained_on_keeps_its_markers(tmp_path):
    takes = read_takes([write(tmp_path / "1.c3d", NAMES[:4])], ())
    assert chosen_markers(takes, None, NAMES) == NAMES
    with pytest.raises(InputError, match="few of the model's markers"):
        chosen_markers(takes, None, tuple("VWXYZA"))
    assert chosen_markers(takes, ["E", "B", "A", "C"], NAMES) == ("E", "B", "A", "C")
    with pytest.raises(InputError, match="no take has a marker Z"):
        chosen_markers(takes, ["A", "B", "C", "Z"], NAMES)


def test_what_is_known_is_put_in_the_order_of_other_markers():
    points = np.arange(12, dtype=np.float32).reshape(1, 4, 3)
    [found] = of_markers([Lessons("ann", ("1",), 9, points)], NAMES[:4], ("C", "E", "A"))
    np.testing.assert_array_equal(found.points[0], [points[0, 2], [np.nan] * 3, points[0, 0]])
    assert (found.subject, found.takes, found.frames, found.points.dtype) == ("ann", ("1",), 9, np.float32)


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda path: write(path, frames=1), "has 1 frame; expected 10 or more"),
        (lambda path: write(path, ("", "", "*3", "", "")), "no named markers"),
        (lambda path: write(path, ("A", "A", "B", "C")), "label A twice"),
        (
            lambda path: write(path, tuple(f"{who}:{name}" for who in ("Ann", "Bob") for name in NAMES)),
            "two subjects (Ann, Bob)",
        ),
        (lambda path: write(path, NAMES[:3]), "3 named markers; expected 4"),
        (lambda path: path.write_text("nothing") and path, "does not begin"),
    ],
)
def test_takes_that_cannot_be_used(tmp_path, make, words):
    with pytest.raises(InputError, match=re.escape(words)) as caught:
        read_takes([make(tmp_path / "take.c3d")], ())
    assert caught.value.file == str(tmp_path / "take.c3d")


@pytest.mark.filterwarnings("error")
def test_a_take_whose_markers_are_all_missing_is_said_without_a_warning(tmp_path):
    xyz = np.random.default_rng(1).uniform(0.1, 1.7, (30, 6, 3))
    xyz[:, :5] = np.nan
    write_c3d(tmp_path / "gone.c3d", Points((*NAMES, ""), xyz, np.zeros((30, 6)), 100.0, 1))
    with pytest.raises(InputError, match="none of its named markers in any frame"):
        read_takes([tmp_path / "gone.c3d"], ())


def test_no_marker_in_common_names_both_takes(tmp_path):
    takes = read_takes([write(tmp_path / "one.c3d"), write(tmp_path / "two.c3d", tuple("VWXYZ"))], ())
    with pytest.raises(InputError, match=r"no marker in common \(one.c3d: A, B, C, D, …; two.c3d: V, W, X, Y, …\)"):
        chosen_markers(takes, None)


def test_a_take_in_another_unit_is_found_by_its_size(tmp_path):
    paths = [write(tmp_path / f"{index}.c3d", seed=index) for index in range(3)]
    with pytest.raises(InputError, match=r"9\.\d+ times as large"):
        read_takes([*paths, write(tmp_path / "big.c3d", size=10.0)], ())


def test_what_is_kept_is_the_most_different_and_grows_by_subject():
    points = np.zeros((500, 4, 3))
    points[:, 0, 0] = np.linspace(0, 0.01, 500)
    points[[100, 321], 1, 2] = 3.0, -3.0
    kept = most_different(points, 20)
    assert len(kept) == 20
    assert {3.0, -3.0} <= set(kept[:, 1, 2].tolist())
    assert len(most_different(points[:7], 20)) == 7
    ann, bob = (Lessons(name, ("1",), 9, np.zeros((2, 4, 3))) for name in ("ann", "bob"))
    both = joined([ann], [Lessons("ann", ("2",), 5, np.ones((3, 4, 3))), bob])
    assert [(lesson.subject, lesson.takes, lesson.frames, len(lesson.points)) for lesson in both] == [
        ("ann", ("1", "2"), 14, 5),
        ("bob", ("1",), 9, 2),
    ]
