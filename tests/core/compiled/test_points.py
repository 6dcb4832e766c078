# SPDX-License-Identifier: GPL-3.0-or-later
"""Settling, odds and exchanges of names in C against NumPy; and the border between Python and C, with one switch."""

import os
import re
import subprocess
import sys
from dataclasses import replace
from functools import cache, partial
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from addon.core.kernels import library
from addon.core.kernels.structures import ADDRESS, COUNT, NUMBER, SIGNATURES, STRUCTURES
from addon.core.points.likelihood import naming, starts
from addon.core.points.likelihood import solving as swaps
from addon.core.points.likelihood.distances import DistanceConstraints
from addon.core.points.likelihood.naming import Settled, name_worth
from addon.core.points.likelihood.shape import Latent, Shape
from addon.core.points.rigid_bodies.structure import median_volumes
from addon.core.points.whole_take.likeness import LIKENESS, of_ends, of_frames
from addon.core.points.whole_take.pairs import distance_sums
from addon.io.models import open_model

from .test_frames import both, refused, same

SEEDS = st.integers(0, 2**16)


@cache
def learned(name: str):
    return open_model(name).likelihood


def toy(markers: int, modes: int = 2) -> tuple[Latent, DistanceConstraints]:
    """A shape of so few markers, and nothing that holds them together."""
    generator = np.random.default_rng(markers)
    mean = generator.normal(0, 0.4, (markers, 3))
    shape = Shape(mean, 0.05 * generator.normal(size=(markers, 3, modes)), np.full(markers, 1e-4))
    return Latent(shape), DistanceConstraints(np.zeros((0, 2), int), np.zeros(0), np.zeros(0), 0.05)


def cloud(model: Latent, generator, count: int, ghosts: int, twins: bool = False):
    """Points of people of such a shape, ghosts among them, and namings that are mostly right: some hide, some swap.

    With `twins` two points of each frame are in one place.
    """
    markers = len(model)
    latent = generator.normal(size=(count, model.size)) * np.where(np.arange(model.size) < 4, 0.02, 1)
    points = model.positions(latent) + np.sqrt(model.noise)[:, None] * generator.normal(size=(count, markers, 3))
    points = np.concatenate([points, generator.normal(0, 0.4, (count, ghosts, 3))], axis=1)
    if twins:
        points[:, -1] = points[:, 0]
    present = generator.random(points.shape[:2]) < 0.95
    points[~present] = 0
    named = np.where(present[:, :markers] & (generator.random((count, markers)) < 0.9), np.arange(markers), -1)
    for row in range(0, count, 2):
        pair = generator.integers(0, markers, 2)
        named[row, pair] = named[row, pair[::-1]]
    named[-1:] = -1  # nobody at all
    return points, present, named


def compared(model, constraints, points, present, named):
    """Compares everything that follows from namings."""
    worth = name_worth(model, present)
    left, *rest = both(naming.settled, model, constraints, points, named, worth)
    same([naming.score_of.kernel(model, constraints, points, worth, named)], rest[:1])
    both(naming.expected_of, model, points, named, np.arange(0, len(model), 2))
    settled = Settled(left, present, worth, named, *rest)
    both(naming.name_odds, model, constraints, settled)
    for reach in (0.0, 0.8 * model.radius, 1e3):
        both(swaps.neighbours, model, constraints, settled, reach)


@settings(max_examples=12, deadline=None)
@given(SEEDS, st.sampled_from(["gait15", "body26", "actor41"]), st.integers(1, 4), st.integers(0, 5))
def test_what_follows_from_namings(seed, name, count, ghosts):
    known = learned(name).known
    generator = np.random.default_rng(seed)
    for model in (known.fine, known.coarse):
        compared(model, known.constraints, *cloud(model, generator, count, ghosts, twins=ghosts > 1))


@settings(max_examples=8, deadline=None)
@given(SEEDS, st.sampled_from(["gait15", "body26", "actor41"]), st.integers(1, 3), st.integers(0, 5))
def test_soft_guesses(seed, name, count, ghosts):
    known, generator = learned(name).known, np.random.default_rng(seed)
    for model, schedule in ((known.coarse, starts.STARTS.coarse), (known.fine, starts.STARTS.fine)):
        points, present, _ = cloud(model, generator, count, ghosts, twins=ghosts > 1)
        latent = 0.3 * generator.normal(size=(count, model.size))
        both(starts.softly, model, points, present, starts.ghost_density(model, present), latent, schedule)


@settings(max_examples=12, deadline=None)
@given(SEEDS, st.sampled_from([1, 2, 3]), st.integers(1, 3))
def test_few_markers_without_constraints(seed, markers, ghosts):
    model, constraints = toy(markers)
    compared(model, constraints, *cloud(model, np.random.default_rng(seed), 3, ghosts))


def test_no_naming_at_all():
    known = learned("gait15").known
    points, present, named = cloud(known.fine, np.random.default_rng(0), 1, 2)
    none = points[:0], present[:0], named[:0]
    settled = naming.settle(known.fine, known.constraints, *none)
    assert len(settled.score) == len(naming.name_odds(known.fine, known.constraints, settled)) == 0


def test_what_does_not_go_together_is_refused():
    known = learned("gait15").known
    model, constraints = known.fine, known.constraints
    points, present, named = cloud(model, np.random.default_rng(0), 2, 2)
    worth = name_worth(model, present)
    settled = naming.settle(model, constraints, points, present, named)
    beyond = np.where(named == 3, points.shape[1], named)
    wild = DistanceConstraints(np.array([[0, -2]]), np.ones(1), np.ones(1), 0.05)
    refused(
        lambda: naming.settled(model, constraints, points, beyond, worth),
        lambda: starts.softly(model, points, present, worth[1:], settled.left[:, 0, :1], ((0.5, 0.1),)),
        lambda: starts.softly(model, points, present, worth, np.zeros((2, 3)), ((0.5, 0.1),)),
        lambda: starts.softly(model, points, present[:, 1:], worth, np.zeros((2, model.size)), ((0.5, 0.1),)),
        lambda: naming.settled(model, constraints, points, named[:, :-1], worth),
        lambda: naming.settled(model, constraints, points[:1], named, worth),
        lambda: naming.settled(model, wild, points, named, worth),
        lambda: naming.score_of(model, constraints, points, worth[:1], named),
        lambda: naming.name_odds(model, constraints, replace(settled, naming=beyond)),
        lambda: swaps.neighbours(model, constraints, replace(settled, spread=settled.spread[..., :-1]), 1.0),
        lambda: swaps.neighbours(model, constraints, replace(settled, present=present[:, :-1]), 1.0),
    )


@settings(max_examples=25, deadline=None)
@given(SEEDS, st.integers(1, 4), st.integers(1, 3), st.sampled_from([1, 2, 8, 20]))
def test_what_distances_to_named_ones_say(seed, tracklets, samples, markers):
    generator = np.random.default_rng(seed)
    placed = generator.normal(0, 0.4, (5, markers, 3)).astype(np.float32)
    placed[generator.random(placed.shape[:2]) < 0.2] = np.nan
    near = np.argsort(generator.random((markers, markers)), axis=1)[:, : max(markers - 1, 1)]
    mean, variance = generator.uniform(0.1, 1, near.shape), generator.uniform(1e-5, 1e-2, near.shape)
    variance[generator.random(near.shape) < 0.1] = np.nan
    xyz = generator.normal(0, 0.4, (tracklets, samples, 3)).astype(np.float32)
    xyz[0, 0] = placed[0, 0]  # in the same place as a marker
    frame, own = generator.integers(-1, 5, xyz.shape[:2]), generator.integers(-1, markers, tracklets)
    asked = generator.random((tracklets, markers)) < 0.7
    arguments = frame, xyz, placed, own, near, mean, variance, asked, LIKENESS
    with np.errstate(all="ignore"):
        both(of_frames, *arguments)
    wrong = (frame + 9, *arguments[1:]), (frame, xyz, placed[:, :0], *arguments[3:])
    refused(*(partial(of_frames.kernel, *one) for one in wrong))


@settings(max_examples=15, deadline=None)
@given(SEEDS, st.integers(4, 30), st.sampled_from([4.0, 20.0]))
def test_how_ends_of_tracklets_are_weighed(seed, markers, rate):
    generator = np.random.default_rng(seed)
    ends, frames, each = 6, 14, min(18, markers - 1)
    placed = generator.normal(0, 0.5, (frames, markers, 3)).astype(np.float32)
    placed[generator.random(placed.shape[:2]) < 0.4] = np.nan
    xyz = generator.normal(0, 0.5, (ends, 3)).astype(np.float32)
    near = np.stack([generator.permutation(markers)[:each] for _ in range(markers)])
    within = generator.uniform(1e-5, 0.1, near.shape)
    within[generator.random(near.shape) < 0.1] = np.nan
    frame, own = generator.integers(0, frames, ends), generator.integers(-1, markers, ends)
    then = generator.integers(-1, frames, (ends, markers))
    arguments = frame, then, np.abs(frame[:, None] - then), xyz, placed, own, near, within, rate, LIKENESS
    with np.errstate(all="ignore"):
        both(of_ends, *arguments)
    wrong = (
        (frame + frames, *arguments[1:]),
        (frame, then + frames, *arguments[2:]),
        (frame, then[:3], *arguments[2:]),
    )
    refused(*(partial(of_ends.kernel, *one) for one in wrong))


@given(SEEDS, st.integers(0, 130), st.integers(1, 9))
def test_distances_are_summed(seed, frames, markers):
    generator = np.random.default_rng(seed)
    points = generator.normal(0, 1, (frames, markers, 3))
    points[generator.random(points.shape[:2]) < 0.2] = np.nan
    both(distance_sums, points)
    refused(lambda: distance_sums.kernel(points[..., :2]))


@settings(max_examples=25, deadline=None)
@given(SEEDS, st.sampled_from([1, 2, 7, 40]), st.integers(4, 9), st.sampled_from([0.0, 0.2, 0.9]))
def test_median_volumes(seed, frames, things, gone):
    generator = np.random.default_rng(seed)
    place = generator.normal(0, 0.4, (things, 3, frames))
    place[1] = place[0]  # in the same place
    place[np.broadcast_to((generator.random((things, frames)) < gone)[:, None], place.shape)] = np.nan
    quads = np.sort(generator.permuted(np.tile(np.arange(things), (20, 1)), axis=1)[:, :4], axis=1)
    both(median_volumes, place, quads)
    refused(*(partial(median_volumes.kernel, place, wrong) for wrong in (quads + things, quads[:, :3])))


ROOT = Path(__file__).resolve().parents[3]
HEADER = (ROOT / "kernels" / "src" / "kernels.h").read_text(encoding="utf-8")
SOURCES = "".join(path.read_text(encoding="utf-8") for path in sorted((ROOT / "kernels" / "src").glob("*.c")))


@pytest.fixture
def library_file() -> Path:
    if library.compiled is None:
        pytest.skip("the compiled library is not in use")
    return Path(library.compiled._name)


def without_comments(text: str) -> str:
    return re.sub(r"/\*.*?\*/", "", text, flags=re.DOTALL)


def declared(text: str) -> list[type]:
    """The types of declarations in C, one for each name: `double a, b[3];` or `const double *a, size_t b`."""
    kinds = []
    for part in filter(None, (part.strip() for part in re.split(r"[;]", text))):
        kind, names = re.fullmatch(r"(?:const )?(\w+) (.*)", part, re.DOTALL).groups()
        for name in names.split(","):
            size = re.search(r"\[(\d+)\]", name)
            one = ADDRESS if "*" in name else {"int64_t": COUNT, "double": NUMBER}[kind]
            kinds.append(one * int(size[1]) if size else one)
    return kinds


@pytest.mark.parametrize("name", STRUCTURES)
def test_structures_are_those_of_the_header(name):
    body = re.search(r"typedef struct \{([^{}]*)\} " + name + ";", without_comments(HEADER), re.DOTALL)[1]
    assert [kind for _, kind in STRUCTURES[name]._fields_] == declared(body)


def test_structures_and_signatures_are_those_of_the_sources():
    assert set(re.findall(r"\} (\w+);", without_comments(HEADER))) == set(STRUCTURES)
    found = {}
    for name, arguments in re.findall(r"^KERNEL \w+ (\w+)\(([^)]*)\) \{", without_comments(SOURCES), re.MULTILINE):
        kinds = [declared(one.strip()) for one in arguments.split(",") if one.strip() != "void"]
        found[name] = [kind for kinds_of_one in kinds for kind in kinds_of_one]
    assert found.pop("version") == []
    assert found == SIGNATURES


def test_numpy_is_used_where_there_is_no_library_or_one_of_another_version(monkeypatch):
    assert library._loaded() is not None
    monkeypatch.setattr(library, "LIBRARY_VERSION", library.LIBRARY_VERSION + 1)
    assert library._loaded() is None
    monkeypatch.setattr(library, "LIBRARY_PACKAGE", "mocap_autolabel_no_kernels")
    assert library._loaded() is None


@pytest.mark.parametrize(("value", "used"), [("1", "False"), ("0", "True"), ("", "True")])
def test_the_switch_chooses(value, used):
    code = "from addon.core.kernels import in_use; print(in_use())"
    environment = os.environ | {library.SWITCH: value, "PYTHONPATH": os.pathsep.join([str(ROOT), *sys.path])}
    assert subprocess.check_output([sys.executable, "-c", code], env=environment, text=True).strip() == used


def test_after_an_update_the_library_is_that_of_the_new_version(tmp_path, monkeypatch, library_file):
    """The package of the version before is still imported then, and its library gone."""
    package = tmp_path / library.LIBRARY_PACKAGE
    package.mkdir()
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setitem(sys.modules, library.LIBRARY_PACKAGE, None)  # so that what is there comes back at the end
    monkeypatch.setattr(sys, "dont_write_bytecode", True)
    monkeypatch.delenv(library.SWITCH, raising=False)
    (package / "__init__.py").write_text(f"PATH = {str(tmp_path / 'gone')!r}\n", encoding="utf-8")
    assert library._loaded() is None
    (package / "__init__.py").write_text(f"PATH = {str(library_file)!r}\n", encoding="utf-8")
    assert library._loaded() is not None
