# SPDX-License-Identifier: GPL-3.0-or-later
"""Gaps of a labelled take filled, from file to file, and of a take that was just labelled."""

from collections.abc import Generator, Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from time import perf_counter

import numpy as np

from ..core.data.columns import Columns, beside_of, markers_in
from ..core.data.errors import InputError
from ..core.data.markersets import MarkerSet, Worn
from ..core.data.progress import Progress, within
from ..core.data.takes import Points, part_of_take
from ..core.edits.kinds import NO_EDITS
from ..core.filling.filling import FilledTake, FillOptions, SubjectMarkers, fill_subjects, kept_fills_of
from ..core.filling.kept import KeptFill
from ..core.filling.rays import NO_RAYS, MarkerRays
from ..core.posing.posing import POSING
from ..core.review.overview import TakeOverview
from ..core.review.summary import SampleOrigins
from ..core.review.take_trouble import TakeTrouble
from ..io.filled import gap_rows, left_rows, write_filled
from ..io.markersets import markerset_file
from ..io.models import open_model
from ..io.points import columns_of_set, marker_columns, read_points, write_c3d
from ..io.provenance import MADE_OF, REPORT, file_rows, own_output, sealed
from ..io.report import renumbered
from ..io.source import digest
from ..io.text import write_json
from ..io.whole import whole_files
from ..version import version

LIST_OF_FILLS = ".filled.csv"


@dataclass(frozen=True)
class FillJob:
    """What to fill."""

    source: Path  # the labelled take, `.c3d`, `.trc`, `.tsv` or Motive `.csv`
    out: Path  # the `.c3d` to write; beside it go a list of the gaps, LIST_OF_FILLS, and what it was made of, REPORT
    method: str = "auto"  # one of FILL_METHODS
    max_gap: int | None = None  # frames of the longest gap to fill, None for any
    markers: tuple[str, ...] = ()  # names of those to fill, empty for all
    model: str | None = None  # a built-in model's name or the path of one, whose body may fill gaps; None for none
    up: str | None = None  # the axis that points up in the file, None for what the file says or shows
    rate: float | None = None  # frames a second, for a file that says none
    plain: bool = False  # write points alone, without what else a C3D file that is read holds
    overwrite: bool = False


def fill_file(job: FillJob) -> Generator[Progress, None, dict]:
    """Fills the gaps of a take and writes all files, which appear together or not at all; gives what there is to say.

    Raises UserError with the file where that is known.
    """
    begin = perf_counter()
    if job.out.suffix.lower() != ".c3d":
        raise InputError("is no file that can say which samples are filled; expected a name that ends in .c3d", job.out)
    if job.method == "body" and job.model is None:
        raise InputError("the method body needs a body to fit; expected --model with a model of these markers")
    listed, beside = (job.out.with_suffix(ending) for ending in (LIST_OF_FILLS, REPORT))
    files = {"input": [job.source], "model": [markerset_file(job.model)] if job.model else []}
    read = [path for some in files.values() for path in some]
    with whole_files([job.out, listed, beside], job.overwrite, read) as (target, table, page):
        made = {"version": version(), **{kind: file_rows(files.get(kind, ()), beside) for kind in MADE_OF}}
        options = ("method", "max_gap", "markers", "up", "rate", "plain")
        made["options"] = {name: getattr(job, name) for name in options}
        take = read_points(job.source, up=job.up, rate=job.rate)
        named = np.array([index for index, name in enumerate(take.names) if name], dtype=int)
        if not len(named):
            raise InputError("has no named markers; expected a labelled take", job.source)
        own = [take.names[index] for index in named]
        subjects = _subjects_of(job, own)
        wanted = FillOptions(job.method, job.max_gap, _wanted(job, own))
        names = _told_apart(own)
        shown = take.picked(named)
        work = fill_subjects(shown.xyz, take.rate, wanted, subjects)
        filled = yield from within(work, 0.0, 0.95)
        points = put_into(take, filled, named)
        present = shown.present
        rows = gap_rows(filled.gaps, names, take.first_frame)
        yield Progress(0.95, "write")
        notes = write_c3d(target, points, None if job.plain else take.trial)
        write_filled(table, rows)
        report = {
            "take": job.source.stem,
            "version": version(),
            "rate": take.rate,
            "first_frame": take.first_frame,
            "frames": len(take.xyz),
            "markers": len(names),
            "never_seen": [name for name, seen in zip(names, present.any(axis=0), strict=True) if not seen],
            "samples_missing": int((~present[:, present.any(axis=0)]).sum()),
            "samples_filled": int(filled.filled.sum()),
            "filled": rows,
            "left": left_rows(filled.left, names, take.first_frame),
            "notes": [*take.notes, *notes],
            **({"unit_assumed": take.assumed} if take.assumed else {}),
            **renumbered(points),
        }
        results = {job.out.suffix: digest(target), LIST_OF_FILLS: digest(table)}
        before = own_output(job.source, take.first_frame)
        report |= {"doubtful": before["doubtful"]} if before else {}
        origins = _origins(shown, names, before, job.source).of_markers(rows, None)
        write_json(page, sealed(report | {"provenance": {**made, "results": results, "markers": origins}}))
    return report | {"out": str(job.out), "seconds": round(perf_counter() - begin, 3)}


def _told_apart(own: Sequence[str]) -> list[str]:
    """The names; one that was there before has its place behind it, and is no other's then."""
    names: list[str] = []
    for place, name in enumerate(own):
        told = name
        while told in names or (told != name and told in own):
            told += f" ({place})"
        names.append(told)
    return names


def _origins(take: Points, names: Sequence[str], report: dict | None, source: Path) -> SampleOrigins:
    """Where the samples of a take's markers are from, as far as it says, and the report beside it where it has one.

    InputError where that is damaged.
    """
    origins, hand = SampleOrigins(names, NO_EDITS, {}), np.zeros(take.xyz.shape[:2], bool)
    try:
        for name, row in report["provenance"].get("markers", {}).items() if report else ():
            for first, last in row.get("hand_frames", ()):
                hand[part_of_take(first, last, take.first_frame), names.index(name)] = True
    except (AttributeError, LookupError, TypeError, ValueError):
        beside = source.with_name(source.stem + REPORT)
        raise InputError("is damaged in what is by hand; expected the report as it was written", beside) from None
    origins.add_samples(take.frames, take.present, take.residual, hand & take.present)
    return origins


def fill_labelled(
    points: Points, markerset: Worn, listeners: Iterable[TakeOverview | TakeTrouble | None], rays: MarkerRays = NO_RAYS
) -> Generator[Progress, None, tuple[Points, dict, tuple[KeptFill, ...]]]:
    """A take whose first columns are the markers of a model, or of several subjects, with their gaps filled.

    They are held by `rays`. Gives it with what a report says of that, and with the fills as a Blender file keeps them.
    `listeners` hear of what was filled.
    """
    own = np.arange(len(markerset))
    xyz = np.asarray(markers_in(points.xyz, len(own)), dtype=float)
    subjects = SubjectMarkers.side_by_side(one for _, one in markerset.worn)
    filled = yield from fill_subjects(xyz, points.rate, FillOptions(), subjects, rays)
    facts = {
        "filled": gap_rows(filled.gaps, markerset.markers, points.first_frame),
        "left": left_rows(filled.left, markerset.markers, points.first_frame),
    }
    for one in (one for one in listeners if one is not None):
        for row in facts["filled"]:
            one.fill(row["marker"], row["first"], row["last"])
    return put_into(points, filled, own), facts, kept_fills_of(filled, markerset.markers, points.frames)


def put_into(points: Points, filled: FilledTake, named: np.ndarray) -> Points:
    """The take with what was filled in some trajectories; its residual is 0: what C3D's users take for filled."""
    xyz, residual = points.xyz, points.residual
    if isinstance(xyz, Columns):  # whose markers are what was filled
        found = np.where(filled.filled, 0.0, residual.markers[:])
        return replace(points, xyz=xyz.with_markers(filled.xyz), residual=residual.with_markers(found))
    if points.lanes is not None:
        column = np.arange(len(points.names))
        column[named] = -1
        found = np.where(filled.filled, 0.0, points.picked(named).residual)
        xyz, residual = (
            Columns(markers, named, len(column), beside_of(points, values, column))
            for markers, values in ((filled.xyz, xyz), (found, residual))
        )
        return Points(points.names, xyz, residual, points.rate, points.first_frame)
    xyz, residual = np.array(xyz, dtype=float), np.array(residual, dtype=float)
    xyz[:, named] = filled.xyz
    residual[:, named] = np.where(filled.filled, 0.0, residual[:, named])
    return replace(points, xyz=xyz, residual=residual)


def _wanted(job: FillJob, names: Sequence[str]) -> tuple[int, ...] | None:
    if not job.markers:
        return None
    columns = marker_columns(names, job.markers, job.source)
    if (columns < 0).any():
        missing = job.markers[int(np.argmin(columns))]
        raise InputError(f"has no marker {missing}; expected names such as {', '.join(names[:3])}", job.source)
    return tuple(columns.tolist())


def _subjects_of(job: FillJob, names: Sequence[str]) -> list[SubjectMarkers]:
    """Whose the markers are: one subject's, or those of several who are called NAME:MARKER, each with the job's model.

    Raises InputError where nobody wears the model.
    """
    owner = np.array([name.rpartition(":")[0] for name in names])
    if sum((owner == one).sum() >= POSING.min_markers for one in set(owner.tolist())) < 2:
        owner[:] = ""
    found, unlike = [], None
    for one in dict.fromkeys(owner.tolist()):
        own = np.flatnonzero(owner == one)
        markerset = columns = None
        if job.model is not None:
            try:
                markerset, columns = _of_model(job, [names[index] for index in own])
            except InputError as error:  # a prop, or somebody in another set
                unlike = error
        found.append(SubjectMarkers(own, markerset, columns))
    if unlike is not None and all(one.markerset is None for one in found):
        raise unlike
    return found


def _of_model(job: FillJob, names: Sequence[str]) -> tuple[MarkerSet, np.ndarray]:
    """The model's markers and where the take has each, by its name or another that the model knows for it."""
    markerset = open_model(job.model).markerset
    columns = columns_of_set(names, markerset, job.source)
    if (columns >= 0).sum() < POSING.min_markers:
        what = f"has {(columns >= 0).sum()} of the markers of {markerset.name}"
        raise InputError(f"{what}; expected {POSING.min_markers} or more, or another model", job.source)
    return markerset, columns
