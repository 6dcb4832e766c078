# SPDX-License-Identifier: GPL-3.0-or-later
"""What can be switched off or varied in naming: every stage by a name, every number set by hand by where it stands."""

import importlib
import pkgutil
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import is_dataclass
from inspect import get_annotations
from types import SimpleNamespace
from unittest.mock import patch

import numpy as np

import addon.core
from addon.blendfile import has_blender, mesh_occlusion
from addon.core.blobs.swaps import try_swaps

# What decides labels; what only draws, fills, trains or simulates is elsewhere.
NAMING = ("blobs", "points", "pipelines", "reconstruction", "body")


def _number(value) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


def _kind(held) -> type:
    """The class that says which numbers there are: constants that stand together are one, others its instance."""
    return held if isinstance(held, type) else type(held)


def numbers() -> dict[str, tuple[object, str, int | None]]:
    """Every number among the constants of naming, by where it stands: who holds it, in which field, at which place."""
    found, seen = {}, set()
    for module in _modules():
        for name, held in vars(module).items():
            if name.isupper() and (isinstance(held, type) or is_dataclass(held)) and id(held) not in seen:
                seen.add(id(held))
                where = f"{_kind(held).__module__.partition('.core.')[2]}.{name}"
                found.update(_numbers_of(where, held))
    return found


def _numbers_of(where: str, held) -> Iterator[tuple[str, tuple[object, str, int | None]]]:
    for field in get_annotations(_kind(held)):
        value = getattr(held, field)
        if _number(value):
            yield f"{where}.{field}", (held, field, None)
        elif isinstance(value, tuple):
            for place, part in enumerate(value):
                if _number(part):
                    yield f"{where}.{field}[{place}]", (held, field, place)
                elif is_dataclass(part):
                    yield from _numbers_of(f"{where}.{field}[{place}]", part)


def _modules():
    for part in NAMING:
        package = importlib.import_module(f"{addon.core.__name__}.{part}")
        for one in pkgutil.walk_packages(package.__path__, package.__name__ + "."):
            yield importlib.import_module(one.name)


@contextmanager
def varied(name: str, factor: float):
    """With one number multiplied; whole numbers stay whole, and are moved by one at least."""
    holder, field, place = numbers()[name]
    before = getattr(holder, field)
    old = before if place is None else before[place]
    new = old * factor
    if isinstance(old, int):
        new = round(new) if round(new) != old else old + (1 if factor > 1 else -1)
    after = new if place is None else (*before[:place], new, *before[place + 1 :])
    setting = type.__setattr__ if isinstance(holder, type) else object.__setattr__
    setting(holder, field, after)
    try:
        yield
    finally:
        setting(holder, field, before)


def _no_layout(likelihood, placed, held):
    return np.arange(placed.shape[1]), ()


def _nothing_tried(known, now, place):
    return np.zeros((0, len(place)), int)


def _no_moves(self, *given) -> Iterator[np.ndarray]:
    return iter(())


def _as_it_is(self, *given) -> np.ndarray:
    return self.best.marker


def _nothing_hidden(rotations, joints, scale, markers, centres) -> np.ndarray:
    return np.zeros((len(markers), len(centres), markers.shape[1]), dtype=bool)


CORE = addon.core.__name__
SEARCH = "points.whole_take.search.Search"
# Of each stage: what stands in its place, by where it is called.
STAGES: dict[str, dict[str, Callable]] = {
    "points: search": {"points.whole_take.solving.Search.climb": lambda self, moves="all": None},
    "points: groups opened": {f"{SEARCH}._opened": _as_it_is},
    "points: groups by shape": {f"{SEARCH}._by_shape": _as_it_is},
    "points: a name shifted on": {f"{SEARCH}._shifted": _no_moves},
    "points: single tracklets": {f"{SEARCH}._of_one": _no_moves},
    "points: chains": {f"{SEARCH}._chains": _no_moves},
    "points: exchanges": {f"{SEARCH}._exchanges": _no_moves},
    "points: names given alone": {f"{SEARCH}._alone": _no_moves},
    "points: as frames say": {f"{SEARCH}._as_said": _no_moves},
    "points: whole frames": {f"{SEARCH}._of_frames": _no_moves},
    "points: markers not put on again": {"points.whole_take.layout_odds.Unmoved.odds": lambda self, shown: 0.0},
    "points: sides": {
        "points.whole_take.layout_odds.LayoutOdds._of_sides": lambda self, orders, most: np.zeros(
            (len(orders), self.markers)
        )
    },
    "points: lonely tracklets": {
        "points.whole_take.solving._Solving._lonely": lambda self, own, search: np.zeros(len(own), bool)
    },
    "points: names by themselves": {
        "points.whole_take.deciding._by_itself": lambda solution, given, part: np.zeros(given.shape, bool)
    },
    "points: likelier a ghost": {
        "points.whole_take.solving._Solving._unlikely": lambda self, own, *_: np.zeros(len(own), bool)
    },
    "points: layout of a crowd": {"points.whole_take.solving.named_by_layout": _no_layout},
    "points: blocks": {"points.whole_take.layout.block_exchanges": _nothing_tried},
    "points: unmodelled markers": {"points.whole_take.solving._Solving._add_extras": lambda self: False},
    "points: links over gaps": {"points.whole_take.objective.links": lambda *given: np.zeros(given[-1].shape)},
    "points: seldom there": {
        "points.whole_take.solving._Solving._of_seldom": lambda self, own: np.full(len(own), np.inf)
    },
    "points: contested names": {
        "points.several.identification.doubt_contested": lambda people, options: None,
        "points.several.together.doubt_contested": lambda people, options: None,
    },
    "points: the whole take": {"points.whole_take.pipeline.can_be_solved": lambda *_: False},
    "points: frames in no order": {"points.whole_take.pipeline.is_unordered": lambda *_: False},
    "frames: limbs exchanged": {"points.likelihood.solving._exchanged": lambda *_: []},
    "blobs: rereading": {"blobs.rereading.Rereader.read_again": lambda *_: ()},
    "blobs: names taken back": {"blobs.rereading.Rereader._withdrawn": lambda *_: []},
    "blobs: markers worn elsewhere": {"blobs.pipeline.TakeLabeller._found_elsewhere": lambda _, chunk, __: chunk},
    "blobs: asked in space": {"pipelines.asked_in_space.pairs_of": lambda *_: []},
    "blobs: review of swaps": {"blobs.pipeline.TakeLabeller._review": lambda _, track, *__: track},
    "blobs: image tracklets": {"blobs.pipeline.name_by_tracklets": lambda *_: None},
    "blobs: swaps in a found frame": {"blobs.search.settle": try_swaps},
    "blobs: occlusion": {"blobs.subject.CapsuleOcclusion": lambda *_: SimpleNamespace(hidden=_nothing_hidden)},
}
if has_blender():
    # Rays are cast at the capsules' meshes instead.
    STAGES["blobs: closed form"] = {"blobs.subject.CapsuleOcclusion": lambda markerset, _: mesh_occlusion(markerset)}
LOOK_AGAIN = ("rereading", "review of swaps", "image tracklets")
TOGETHER = {"blobs: all that look again": [f"blobs: {name}" for name in LOOK_AGAIN]}


@contextmanager
def without(*names: str):
    """With some stages switched off; one of `TOGETHER` is all that it names."""
    with ExitStack() as stack:
        for name in names:
            for one in TOGETHER.get(name, [name]):
                for where, instead in STAGES[one].items():
                    stack.enter_context(patch(f"{CORE}.{where}", instead))
        yield


@contextmanager
def variant(name: str):
    """What a result is of: `all`, `without STAGE`, or `NUMBER*FACTOR`."""
    if name == "all":
        yield
    elif name.startswith("without "):
        with without(name.removeprefix("without ")):
            yield
    else:
        number, _, factor = name.rpartition("*")
        with varied(number, float(factor)):
            yield
