# SPDX-License-Identifier: GPL-3.0-or-later
"""Files of labelled takes to learn from: which markers, whose, and every way in which they cannot be used."""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from fnmatch import fnmatchcase
from pathlib import Path

import numpy as np

from ..core.data.errors import InputError, of_file
from ..core.data.markersets import MarkerSet
from ..core.data.takes import part_of_take
from ..core.data.wording import count_of, listed
from ..core.pipelines.known_sets import WORN
from ..core.points.possible import refuse_labelled
from ..core.posing.posing import POSING
from ..core.review.answering import right_in
from ..core.training.takes import LabelledTake, learnable, odd_size
from ..core.training.transfer import known_body, known_places
from ..io.edits import edits_beside, read_edits
from ..io.models import MAX_MARKER_M
from ..io.points import FilePoints, read_points
from ..io.provenance import REPORT, own_output
from ..io.text import can_be_named, written


@dataclass(frozen=True)
class KnownBetter:
    """What is known of a take better than from its file: the axis that points up, and the rate where it says none."""

    up: str | None = None
    rate: float | None = None


@dataclass(frozen=True, eq=False)
class TakeFile(LabelledTake):
    """A labelled take and where it is."""

    path: Path = Path()


def read_takes(
    paths: Sequence[Path], subjects: Sequence[tuple[str, str]], known: Mapping[Path, KnownBetter] | None = None
) -> list[TakeFile]:
    """The labelled takes, each with its subject: the first of `subjects` (id, glob) that its path suits, or its folder.

    Folders of one name are one subject. `known` is what is known better of a take than from its file.

    Raises InputError with the file where one cannot be learned from.
    """
    takes = [_read(path, subjects, (known or {}).get(path, KnownBetter())) for path in paths]
    unused = [glob for _, glob in subjects if not any(suits(path, glob) for path in paths)]
    if unused:
        raise InputError(f"no take suits the subject {unused[0]!r}; expected a pattern such as '*/ann_*.c3d'")
    odd = odd_size([take.xyz for take in takes])
    if odd is not None:
        index, ratio = odd
        raise InputError(
            f"is {ratio:.3g} times as large as the other takes, so its unit was not understood; "
            "expected a file that says its unit",
            takes[index].path,
        )
    return takes


def _read(path: Path, subjects: Sequence[tuple[str, str]], known: KnownBetter) -> TakeFile:
    folder = path.resolve().parent.name or "subject"  # of a drive there is no name
    subject = next((name for name, glob in subjects if suits(path, glob)), folder)
    with of_file(path):
        points = read_points(path, up=known.up, rate=known.rate)
        whole, xyz, doubled, filled = _named(points, trajectories_of(points, subject))
        if np.nanmax(np.abs(xyz)) > MAX_MARKER_M:
            words = f"has markers over {MAX_MARKER_M:g} m from its origin"
            raise InputError(f"{words}; expected places in a room, in a file that says their unit")
    names = tuple(name.rpartition(":")[2] for name in whole)
    doubts = [f"{path.name} has the label {name} twice, so it was left out there" for name in doubled]
    if filled:
        doubts.append(f"{path.name}: {count_of(filled, 'sample')} filled and not measured, so not learned")
    own = own_output(path, points.first_frame)
    if own is not None:
        xyz, doubted = looked_at(own, path, whole, xyz, points.first_frame)
        doubts += [f"{path.name}: {words}" for words in doubted]
    if points.assumed:
        doubts.append(f"{path.name} names no unit that is known, so it was taken to be in {points.assumed}")
    doubts += [f"{path.name}: {note}" for note in points.notes]
    return TakeFile(written(path.name), written(subject), names, xyz, tuple(doubts), path)


def refuse_labels(takes: Sequence[TakeFile], bodies: Sequence[MarkerSet]):
    """Raises ForceableError for the first take that cannot be as it is, by a known body whose markers it names."""
    for take in takes:
        body = known_body([name for name in take.names if any(name in one.by_name for one in bodies)], bodies)
        if body is not None:
            places = known_places(body, take.names)
            points = np.full((len(take.xyz), len(body), 3), np.nan)
            points[:, places[places >= 0]] = take.xyz[:, places >= 0]
            with of_file(take.path if take.path.name else take.name):
                refuse_labelled(body, points)


def looked_at(
    report: dict, path: Path, names: Sequence[str], xyz: np.ndarray, first_frame: int
) -> tuple[np.ndarray, tuple[str, ...]]:
    """Of our own take's markers (T, P, 3) m what is worth learning, by its report and by the edits beside it.

    What was filled was not measured; what was doubtful teaches once a person said that it is right.
    """
    asked, filled = (np.zeros(xyz.shape[:2], bool) for _ in range(2))
    for flags, spans in zip((asked, filled), _spans(report, path), strict=True):
        for name, first, last in spans:
            if name in names:
                flags[part_of_take(first, last, first_frame), list(names).index(name)] = True
    edits = edits_beside(path)
    if edits is not None:
        of_name = {name: at for at, name in enumerate(names)}
        frames = report.get("first_frame", first_frame) + np.arange(len(xyz))  # edits call them as the source does
        asked &= ~right_in(read_edits(edits), of_name, frames)
    learned, doubts = learnable(np.where(filled[..., None], np.nan, xyz), asked, names)
    refuse_doubtful(learned)
    return learned, doubts


def _spans(report: dict, path: Path) -> tuple[list[tuple[str, int, int]], list[tuple[str, int, int]]]:
    """What was doubtful and what was filled, as name, first and last frame; InputError where the report is damaged.

    It is not passed over then: what nobody is sure of would be learned.
    """
    try:
        doubtful = [(name, first, last) for name, spans in report["doubtful"].items() for first, last in spans]
        filled = [(row["marker"], row["first"], row["last"]) for row in report.get("filled", [])]
        if all(type(frame) is int for _, *frames in (*doubtful, *filled) for frame in frames):
            return doubtful, filled
    except (AttributeError, LookupError, TypeError, ValueError):
        pass
    beside = path.with_name(path.stem + REPORT)
    raise InputError("is damaged in what was doubtful or filled; expected the report as it was written", beside)


def refuse_doubtful(xyz: np.ndarray):
    """Raises InputError where nothing of a take (T, M, 3) can be learned."""
    if not np.isfinite(xyz).any():
        raise InputError(
            "is doubtful in all of its frames, and nobody looked at it; expected labels that a person corrected, or "
            "said to be right"
        )


def suits(path: Path, glob: str) -> bool:
    """Whether a pattern is of a take."""
    return any(fnmatchcase(text, glob) for text in (path.name, path.as_posix(), path.resolve().as_posix()))


def trajectories_of(points: FilePoints, subject: str) -> list[int]:
    """The places of a subject's trajectories and of those without a name; of a take of one subject these are all.

    So they are where the subject is none of several, whose markers are called NAME:MARKER.
    """
    owners = {name.rpartition(":")[0] for name in points.names if name}
    alone = len(owners) < 2 or subject not in owners
    return [place for place, name in enumerate(points.names) if alone or not name or name.startswith(f"{subject}:")]


def _named(points: FilePoints, own: Sequence[int]) -> tuple[tuple[str, ...], np.ndarray, tuple[str, ...], int]:
    """Names and measured points of some trajectories named once, names that are there twice, how many were filled."""
    kept = [index for index in own if points.names[index]]
    if not kept:
        raise InputError("has no named markers; expected a labelled take")
    owners = sorted({points.names[index].rpartition(":")[0] for index in kept})
    bare = [points.names[index].rpartition(":")[2] for index in kept]
    doubled = [name for name, count in Counter(bare).items() if count > 1]
    if len(owners) > 1 and len(doubled) >= POSING.min_markers:
        words = f"has {count_of(len(owners), 'subject')} ({listed(owners)})"
        raise InputError(f"{words}; expected a take of one, or one of them chosen, as by --subject {owners[-1]}=GLOB")
    kept = [index for index, name in zip(kept, bare, strict=True) if name not in doubled]
    if len(kept) < POSING.min_markers:
        raise (
            InputError(f"has the label {doubled[0]} twice; expected every marker once")
            if doubled
            else InputError(f"has {count_of(len(kept), 'named marker')}; expected {POSING.min_markers} or more")
        )
    chosen = points.picked(kept)
    filled = np.isfinite(chosen.xyz[..., 0]) & (chosen.residual == 0)
    xyz = np.where(filled[..., None], np.nan, chosen.xyz)
    if not np.isfinite(xyz).any():
        raise InputError("shows none of its named markers in any frame; expected a labelled take")
    return tuple(points.names[index] for index in kept), xyz, tuple(doubled), int(filled.sum())


def unseen_markers(takes: Sequence[TakeFile], bodies: Sequence[MarkerSet]) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Markers that all takes name, none shows: those that a known body has, so that they can stay; and the others."""
    common = set.intersection(*(set(take.names) for take in takes))
    names = [name for name in takes[0].names if name in common]
    unseen = [name for name in names if not any(_has(take, name) for take in takes)]
    # Of other bodies it is not known how people differ, so nobody can be made up who shows the marker.
    body = known_body(names, [one for one in bodies if len(one.spread.modes)]) if unseen else None
    known = [] if body is None else [one for one, at in zip(names, known_places(body, names), strict=True) if at >= 0]
    return tuple(name for name in unseen if name in known), tuple(name for name in unseen if name not in known)


def chosen_markers(
    takes: Sequence[TakeFile], wanted: Sequence[str] | None, base: Sequence[str] = (), known: Sequence[str] = ()
) -> tuple[str, ...]:
    """The markers to learn: `wanted`, or those of the model that is trained on, or those that all takes have.

    Those that no take shows stay where they are `known`; but as many as no take of a set lacks were not worn.

    Raises InputError where a wanted one is nowhere, too few are common, or the takes have few of the model's.
    """
    if wanted or base:
        markers = tuple(dict.fromkeys(wanted or base))
        lacking = [name for name in markers if not any(_has(take, name) for take in takes)]
        unknown = [name for name in lacking if name not in (*base, *known)]
        if unknown:
            raise InputError(f"no take has a marker {unknown[0]}; expected some of {', '.join(takes[0].names[:12])}, …")
        if base and len(lacking) > len(markers) / 2:
            raise InputError(
                f"has few of the model's markers ({', '.join(base[:6])}, …); expected takes that wear them",
                takes[0].path,
            )
    else:
        shown = set.intersection(*({name for name in take.names if _has(take, name)} for take in takes))
        common = shown | {*known}
        common = common if len(common - shown) <= WORN.max_absent * len(common) else shown
        markers = tuple(name for name in takes[0].names if name in common)
        if len(markers) < POSING.min_markers <= min(len(take.names) for take in takes):
            one, two = _least_alike(takes)
            what = "have no marker in common" if not markers else f"have only {', '.join(markers)} in common"
            raise InputError(
                f"the takes {what} ({one.path.name}: {', '.join(one.names[:4])}, …; {two.path.name}: "
                f"{', '.join(two.names[:4])}, …); expected takes of one marker set, or --markers",
                two.path,
            )
    odd = next((name for name in markers if not can_be_named(name)), None)
    if odd is not None:
        raise InputError(
            f"has a marker {odd!r}, which has a sign that label files need; "
            'expected names without | , " or a leading *, or others chosen with --markers',
            takes[0].path,
        )
    if len(markers) < POSING.min_markers:
        raise InputError(
            f"{count_of(len(markers), 'marker')} cannot be told apart; expected {POSING.min_markers} or more"
        )
    return markers


def _has(take: TakeFile, name: str) -> bool:
    return name in take.names and bool(np.isfinite(take.xyz[:, take.names.index(name)]).any())


def _least_alike(takes: Sequence[TakeFile]) -> tuple[TakeFile, TakeFile]:
    names = [set(take.names) for take in takes]
    pairs = [(one, two) for one in range(len(takes)) for two in range(one + 1, len(takes))] or [(0, 0)]
    one, two = min(pairs, key=lambda pair: len(names[pair[0]] & names[pair[1]]))
    return takes[one], takes[two]
