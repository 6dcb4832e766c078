# SPDX-License-Identifier: GPL-3.0-or-later
"""What to label, and what the jobs of all kinds of input share: their files, their clock, their report."""

from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path
from time import perf_counter

from ..blendfile import Chunks, save_blend
from ..core.blobs.pipeline import Options
from ..core.blobs.search import Hints
from ..core.body.occlusion import Occlusion
from ..core.data.markersets import MarkerSet
from ..core.data.takes import PointRows, Points
from ..core.geometry.cameras import Cameras
from ..core.pipelines.points import USUAL_TARGET
from ..core.review.summary import TakeSummary
from ..io.labels import write_point_labels
from ..io.points import write_c3d, write_trc
from ..io.report import take_report, write_report
from ..io.whole import whole_files
from ..version import version

USUAL_RATE = 100.0
# Rays cast at meshes, which takes Blender, or the closed form for capsules; "auto" is the first where Blender is here.
OCCLUSIONS = ("auto", "bvh", "capsules")


@dataclass(frozen=True)
class LabelJob:
    """What to label and what to make of it.

    source    the file of blobs or 3D points; `out` gets files named after its stem
    cameras   the calibration, a file or what was read of one; None for points
    model     a built-in model's name or the path of one
    frames    first and last frame to label, both included, None for the take's own
    method    how names are found: one of METHODS
    rate      frames a second, None where nobody knows: then USUAL_RATE, and the report says that it was assumed
    target    the part of the labels of points that must be right; what is less sure is left unnamed
    height    the subject's height, m, and facing, rad, where known
    occlusion one of OCCLUSIONS: what asks whether the body hides a marker of blobs
    body      meshes of the user's own for that; None for those of the marker set's capsules
    trc       write STEM.trc too
    blend     save STEM.blend too; needs Blender
    keep      give the labelled chunks back as well: memory then grows with the take
    """

    source: Path
    cameras: Path | Cameras | None
    model: str
    out: Path
    frames: tuple[int | None, int | None] | None = None
    method: str = "auto"
    target: float = USUAL_TARGET
    rate: float | None = None
    height: float | None = None
    facing: float | None = None
    occlusion: str = "auto"
    body: Occlusion | None = None
    trc: bool = False
    blend: bool = False
    overwrite: bool = False
    keep: bool = False

    @property
    def frame_rate(self) -> float:
        """Frames a second, given or assumed."""
        return USUAL_RATE if self.rate is None else self.rate

    @property
    def options(self) -> Options:
        """The user's hints as the labelling takes them."""
        return Options(hints=Hints(self.height, self.facing))

    def path(self, ending: str) -> Path:
        """The file of this take with an ending such as `.c3d`."""
        return self.out / (self.source.stem + ending)


@dataclass(frozen=True, eq=False)
class Labelled:
    """What became of a job: the report, and with `keep` the blobs and what was said of them, chunk by chunk."""

    report: dict
    chunks: Chunks


def open_files(job: LabelJob, stack: ExitStack) -> dict[str, Path]:
    """Temporaries of all files that the job writes, by ending; they take their places when `stack` ends well."""
    endings = [".labels.csv", ".c3d", ".report.json"]
    endings += [ending for ending, wanted in ((".trc", job.trc), (".blend", job.blend)) if wanted]
    parts = stack.enter_context(whole_files([job.path(ending) for ending in endings], job.overwrite))
    return dict(zip(endings, parts, strict=True))


@dataclass(frozen=True, eq=False)
class Outcome:
    """What the labelling made of a take, to be written.

    points   the markers in space, then what stays unnamed of points
    chunks   rows and what is said of them; of blobs only where the job keeps them
    cameras  that saw it; none for points
    summary  for the report, and `facts` that only some reports say
    """

    points: Points
    chunks: Chunks
    cameras: Cameras
    summary: TakeSummary
    facts: dict


def write_take(job: LabelJob, files: dict[str, Path], markerset: MarkerSet, made: Outcome, clock: dict) -> dict:
    """Writes all files of a take but the labels of blobs, which are written chunk by chunk; gives the report."""
    rate = made.points.rate
    with timed(clock, "write"):
        for rows, chunk in made.chunks:
            if isinstance(rows, PointRows):
                write_point_labels(files[".labels.csv"], rows, chunk.labels, markerset.markers)
        write_c3d(files[".c3d"], made.points)
        if job.trc:
            write_trc(files[".trc"], made.points)
        if job.blend:
            save_blend(files[".blend"], job.source, rate, markerset, made.chunks, made.cameras)
    report = take_report(made.summary, job.source.stem, markerset.name, rate, version(), clock)
    report |= renumbered(made.points) | made.facts
    if "points" in report:
        del report["blobs"]
    write_report(files[".report.json"], report)
    return report


def renumbered(points: Points) -> dict:
    """What a report says where a C3D file cannot number frames as the source does: it has no room for a sign."""
    return {"c3d_first_frame": 0} if points.first_frame < 0 else {}


@contextmanager
def timed(clock: dict[str, float], stage: str) -> Iterator[None]:
    """Adds the seconds that the block takes to a stage."""
    begin = perf_counter()
    yield
    clock[stage] = clock.get(stage, 0.0) + perf_counter() - begin
