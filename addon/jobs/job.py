# SPDX-License-Identifier: GPL-3.0-or-later
"""What to label, what the results are made of, and what jobs of all kinds of input share."""

import hashlib
import json
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, fields
from functools import cached_property
from pathlib import Path
from time import perf_counter
from typing import TYPE_CHECKING

from ..blendfile import Chunks, inside_blender, open_cameras
from ..core.data.errors import ForceableError, InputError
from ..core.data.markersets import Worn
from ..core.data.wording import count_of
from ..core.edits.kinds import NO_EDITS, Edits
from ..core.geometry.cameras import Cameras
from ..core.geometry.force_plates import NO_LAB, LabRecords
from ..core.points.models import USUAL_TARGET, plain_method
from ..io.cameras import calibration_files
from ..io.edits import edits_beside
from ..io.markersets import AUTO_MODEL, markerset_file
from ..io.models import known_models
from ..io.provenance import REPORT, earlier_run, file_rows
from ..io.qtm.capture import USE_BLOBS, USE_POINTS, held_in, is_qtm
from ..io.text import written
from ..io.whole import is_read, whole_files
from ..version import version

if TYPE_CHECKING:
    from ..core.blobs.search import Hints
    from ..core.papers.virtual_occlusions.occlusion import Occlusion


USUAL_RATE = 100.0
# What of a job holds for any part of its take.
FOR_ANY_PART = (
    "model", "subjects", "wearers", "up", "mirror", "use", "method", "target", "rate", "height", "facing", "occlusion",
    "force",
)  # fmt: skip
PAGE = ".report.html"
MOTION_FILE = ".motion.pc2"  # beside a Blender file whose take is too long for keys
# Rays cast at meshes, which takes Blender, or the closed form for capsules; "auto" is the first inside Blender.
OCCLUSIONS = ("auto", "bvh", "capsules")


def occlusion_here(wanted: str) -> str:
    """The one of OCCLUSIONS that "auto" stands for at this moment, or the one that was wanted."""
    return wanted if wanted != "auto" else "bvh" if inside_blender() else "capsules"


@dataclass(frozen=True)
class LabelJob:
    """What to label and what to make of it."""

    source: Path  # the file of blobs or 3D points; `out` gets files named after its stem
    cameras: Path | Cameras | None  # the calibration, a file or what was read of one; None for points
    model: str  # a built-in model's name or the path of one; AUTO_MODEL for the known one that the take shows
    out: Path
    own: Path | None = None  # the user's folder of models, which are then known too
    subjects: int = 1  # how many wear the model, AUTO for as many as there are; 1 is who has no name
    # who wears what, by name: models as above, of whom `model` is the first one's; none without names
    wearers: tuple[tuple[str, str], ...] = ()
    # first and last frame to label, both included, None for the take's own
    frames: tuple[int | None, int | None] | None = None
    up: str | None = None  # the axis that points up in the files that are read, None for what they say or tell
    mirror: bool = False  # one axis of the 3D points is reversed when they are read, as they are left-handed
    use: str | None = None  # "blobs" or "points": which to label of a capture that holds both; None for its own choice
    method: str = "auto"  # how names are found: one of METHODS
    # the part of the names that must be right, by distances in space; what is less sure is left unnamed
    target: float = USUAL_TARGET
    # frames a second, None where nobody knows: then USUAL_RATE, and the report says that it was assumed; of points only
    # for files that say none
    rate: float | None = None
    height: float | None = None  # the subject's height, m, and facing, rad, where known
    facing: float | None = None
    occlusion: str = "auto"  # one of OCCLUSIONS: what asks whether the body hides a marker of blobs
    body: "Occlusion | None" = None  # meshes of the user's own for that; None for those of the marker set's capsules
    # what a person said of the labels, or the file of it; None for STEM.edits.json beside the take, if there
    edits: Path | Edits | None = None
    plain: bool = False  # write STEM.c3d of points alone, without what else a C3D file that is read holds
    trc: bool = False  # write STEM.trc too
    fill: bool = False  # fill the markers' gaps in STEM.c3d, STEM.trc and, marked as such, STEM.blend; labels never are
    blend: bool = False  # save STEM.blend too, and STEM.motion.pc2 where the take is too long for keys; needs Blender
    html: bool = False  # write STEM.report.html too
    overwrite: bool = False
    resume: bool = False  # go on with what a run of the same job left, and put its own files in their places again
    keep: bool = False  # give the labelled chunks back as well: memory then grows with the take
    force: bool = False  # name markers although something of the take cannot be as it is: see `ForceableError`
    # the take will have keys in a scene that is open, and is refused as soon as they are known to be too many
    shown: bool = False

    def doubted(self, *checks: Callable[[], None]) -> list[str]:
        """Runs checks until one raises ForceableError; where the job is forced, what that says, for the report."""
        try:
            for check in checks:
                check()
        except ForceableError as error:
            if not self.force:
                raise
            return [error.message]
        return []

    @property
    def several(self) -> bool:
        """Whether subjects have names, so that markers are called NAME:MARKER."""
        return self.subjects != 1 or bool(self.wearers)

    @cached_property
    def models(self) -> list[str]:
        """What is worn, or may be where that is to be found, each model once: names and paths.

        The folder is looked into once: a set that is saved meanwhile is of the next job.
        """
        if self.model == AUTO_MODEL:
            return known_models(self.own)
        return list(dict.fromkeys(model for _, model in self.wearers)) or [self.model]

    @property
    def frame_rate(self) -> float:
        """Frames a second, given or assumed."""
        return USUAL_RATE if self.rate is None else self.rate

    @property
    def casts(self) -> str:
        """What asks whether the body hides a marker: "bvh" or "capsules"."""
        return occlusion_here(self.occlusion)

    def for_a_part(self, holds_points: bool) -> dict:
        """What labels a part of the same take in the same way, for `part_job`; files by their whole paths."""
        found = {name: getattr(self, name) for name in FOR_ANY_PART}
        found["model"] = _whole(self.model)
        found["wearers"] = [(name, _whole(model)) for name, model in self.wearers]
        found["use"] = self.use or (USE_POINTS if holds_points else USE_BLOBS)
        return {"source": written(str(self.source.absolute())), **found}

    @property
    def hints(self) -> "Hints":
        """What the user says of the subject."""
        from ..core.blobs.search import Hints

        return Hints(self.height, self.facing)

    def path(self, ending: str) -> Path:
        """The file of this take with an ending such as `.c3d`."""
        return self.out / (self.source.stem + ending)

    @property
    def endings(self) -> list[str]:
        """Those of all files that the job may write, in the order in which they appear; the motion is of long takes."""
        optional = ((".trc", self.trc), (MOTION_FILE, self.blend), (".blend", self.blend), (PAGE, self.html))
        more = [ending for ending, wanted in optional if wanted]
        return [".labels.csv", ".c3d", *more, REPORT]

    @property
    def written(self) -> list[Path]:
        """The files that the job writes."""
        return [self.path(ending) for ending in self.endings]

    @property
    def read(self) -> list[Path]:
        """The files that the job reads; InputError where a calibration lacks one."""
        cameras = calibration_files(self.cameras) if isinstance(self.cameras, Path) else []
        edits = [] if self.edits_file is None else [self.edits_file]
        return [self.source, *map(markerset_file, self.models), *cameras, *edits]

    @property
    def edits_applied(self) -> Edits | Path | None:
        """The edits that are applied, or their file; None where there are none."""
        return edits_beside(self.source) if self.edits is None else self.edits

    @property
    def edits_file(self) -> Path | None:
        """The file of the edits that are applied, None where they are of none."""
        edits = self.edits_applied
        return None if isinstance(edits, Edits) else edits


@dataclass(frozen=True, kw_only=True)
class RoomJob:
    """What jobs have in common that go from what the cameras of a room saw to a file."""

    cameras: Path | Cameras  # the calibration, a file or what was read of one
    out: Path  # the file to write
    # first and last frame, both included, None for the source's own
    frames: tuple[int | None, int | None] | None = None
    up: str | None = None  # the axis that points up in the calibration, None for what it says or tells
    overwrite: bool = False

    def opened(self) -> tuple[Cameras, list[Path]]:
        """The cameras, and the files that they are read from."""
        if isinstance(self.cameras, Cameras):
            return self.cameras, []
        return open_cameras(self.cameras, self.up), calibration_files(self.cameras)


def part_job(facts: dict, cameras: Cameras | None, frames: tuple[int, int]) -> LabelJob:
    """The job that labels these frames of a take as `for_a_part` said; `cameras` where it holds blobs."""
    known = {name: facts[name] for name in FOR_ANY_PART if name in facts}
    known["wearers"] = tuple((name, model) for name, model in known.get("wearers", ()))
    return LabelJob(Path(facts["source"]), cameras, out=Path(), frames=frames, **known)


def _whole(model: str) -> str:
    """A built-in model's name, or the whole path of one."""
    file = markerset_file(model)
    return model if file != Path(model) else written(str(file.absolute()))


@dataclass(frozen=True, eq=False)
class Labelled:
    """What became of a job."""

    report: dict  # as the file has it
    worn: Worn  # whose markers were named: one set, or those that several subjects wear
    chunks: Chunks  # with `keep` the blobs or points and what was said of them, chunk by chunk
    edits: Edits = NO_EDITS  # those that were applied
    model: str = ""  # what is worn, as a job has it: the first one's of several
    lab: LabRecords = NO_LAB  # events and force plates of the take's file


@contextmanager
def timed(clock: dict[str, float], stage: str) -> Iterator[None]:
    """Adds the seconds that the block takes to a stage."""
    begin = perf_counter()
    yield
    clock[stage] = clock.get(stage, 0.0) + perf_counter() - begin


def calibration_for(source: Path, cameras: Path | None) -> Path:
    """The calibration of a take of blobs: the one that was named, else its own; InputError where there is none."""
    if cameras is not None:
        return cameras
    if is_qtm(source):
        return source
    words = "holds blobs, and there is no calibration of their cameras"
    raise InputError(f"{words}; expected --cameras or, in Blender, the calibration to be opened", source)


def blob_rate(source: Path, rate: float | None) -> float | None:
    """Frames a second of a take of blobs: those that were given, else its own; None where nobody knows."""
    return held_in(source).rate if rate is None and is_qtm(source) else rate


def told_by_capture(source: Path, cameras: Path | None, rate: float | None) -> dict:
    """Both, as fields of a job of blobs."""
    return {"cameras": calibration_for(source, cameras), "rate": blob_rate(source, rate)}


def capture_notes(source: Path, points: bool, cameras: Cameras | None = None) -> list[str]:
    """What was taken of a capture, and which of its cameras are left out of `cameras`, a sentence each."""
    if not is_qtm(source):
        return []
    held = held_in(source)
    choice = held.chosen(USE_POINTS if points else USE_BLOBS, None if cameras is None else cameras.names)
    notes = [f"of {source.name}, {choice}"] if choice else []
    left = [] if cameras is None else [name for name in held.calibrated if name not in cameras.names]
    if left:
        words = f"the blobs of {count_of(len(left), 'camera')} that the calibration does not have are left out"
        notes.append(f"of {source.name}, {words}: {', '.join(left)}")
    return notes


def facts_of_capture(source: Path, cameras: Cameras | None = None) -> dict:
    """The same as part of a report, and what was decided about the `cameras` of a take of blobs; None for points."""
    remarks = [] if cameras is None else list(cameras.remarks)
    facts = {"capture": capture_notes(source, cameras is None, cameras), "calibration": remarks}
    return {name: value for name, value in facts.items() if value}


# Fields of a job that make no difference to what its files hold, or are told by their content.
OUTSIDE = ("source", "cameras", "model", "own", "out", "body", "edits", "overwrite", "resume", "keep", "shown")

# Files that one run writes beside its report and another does not.
OPTIONAL = (".trc", ".blend", PAGE, MOTION_FILE)


def made_of(job: LabelJob) -> dict:
    """What the results come from: version, content of the files that are read, options. To be asked before they are.

    Raises InputError where one of them cannot be read.
    """
    options = {field.name: getattr(job, field.name) for field in fields(job) if field.name not in OUTSIDE}
    # Names for one thing are one.
    options |= {
        "occlusion": job.casts,
        "method": plain_method(job.method),
        "wearers": [name for name, _ in job.wearers],
    }
    worn = [model for _, model in job.wearers] or job.models
    given = {"cameras": job.cameras, "edits": job.edits_applied}
    cameras, edits = (one if isinstance(one, Path) else None for one in given.values())
    files = {
        "input": [job.source],
        "cameras": calibration_files(cameras) if cameras else [],
        "model": map(markerset_file, worn),
        "edits": [edits] if edits else [],
    }
    report = job.path(REPORT)
    made = {"version": version(), **{kind: file_rows(some, report) for kind, some in files.items()}, "options": options}
    if job.model == AUTO_MODEL:  # which is found is known later; by these and the take it is the same again
        options["models"] = sorted(row["sha256"] for row in made["model"])
    for kind, one in given.items():  # in no file
        if one and not isinstance(one, Path):
            made[kind] = [{"file": "", "sha256": hashlib.sha256(repr(one).encode()).hexdigest()}]
    return json.loads(json.dumps(made, default=str))  # as it is read back


def results_of(job: LabelJob) -> dict | None:
    """The report of an earlier run of the same job, where all that it made is there as it made it; else None.

    Raises InputError where what is there was made otherwise, or changed since, and the job may not replace it.
    """
    try:
        report, missing = earlier_run(job.path(REPORT), made_of(job))
    except InputError:
        if job.overwrite:
            return None
        raise
    return None if missing else report


def open_files(job: LabelJob, stack: ExitStack) -> tuple[dict, dict[str, Path]]:
    """What the results are made of, and temporaries of all files that the job writes, by ending.

    They take their places when `stack` ends well: those of files that are there only where the job was told to replace
    them, or goes on with what a run of it left.
    """
    made = made_of(job)
    replace = job.overwrite or (job.resume and earlier_run(job.path(REPORT), made)[0] is not None)
    parts = stack.enter_context(whole_files(job.written, replace, job.read))
    return made, dict(zip(job.endings, parts, strict=True))


def leftovers(job: LabelJob) -> list[Path]:
    """Files that look like results of this job and are not of it, where it may replace those of an earlier one."""
    paths = [job.path(ending) for ending in OPTIONAL if job.overwrite and ending not in job.endings]
    return [path for path in paths if path.is_file() and not is_read(path, job.read)]
