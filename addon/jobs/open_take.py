# SPDX-License-Identifier: GPL-3.0-or-later
"""A take that is open to be labelled, and what is asked of it."""

from contextlib import ExitStack
from functools import cached_property
from typing import TYPE_CHECKING

from ..core.data.errors import InputError
from ..core.data.markersets import Worn
from ..core.data.takes import Blobs, LabelledChunk, PointRows
from ..core.geometry.cameras import NO_CAMERAS, Cameras
from ..core.geometry.force_plates import NO_LAB, LabRecords
from ..core.points.models import Model
from ..core.points.several.wearers import SeveralOptions, Wearer
from ..io.c3d.file import TrialFile
from ..io.c3d.lab import read_lab
from ..io.edits import open_edits
from ..io.samples import TextHead
from .job import LabelJob

if TYPE_CHECKING:
    from ..core.filling.rays import MarkerRays


TakePart = tuple[Blobs | PointRows, list[str], LabelledChunk, float]  # with the keys of its rows, and the part read


class OpenTake:
    """A take while it is labelled; `PointTake` and `BlobTake` say what is different.

    shown     reads the part of it that marker sets are found by, or more, as points; with how they may be turned, as
              `known_worn` has it
    read      opens the take, and gives what edits are checked by; InputError for what cannot be labelled
    name      names what is named of the whole take at once, and refuses what cannot be named
    parts     the named parts, in their order; they may be long where all of them are kept
    doubts    what the motion of a part shows, and the suspects that are about it
    end       what all of it shows: notes and suspects; ForceableError where it cannot be, as `check_sides` raises it
              where its markers are on the other sides of the body
    facts     what the report says beside what every report says
    points    the markers in space, then what stays unnamed of points
    keys      the columns that tell one row of its labels from another
    mend      what is expected of a take that is mirrored
    in_parts  whether it is named part by part, so that progress is told of the parts
    long      whether it has too many frames for keys; None where that shows only while it is read
    cameras   that saw it; none for points
    edits     those that the labels follow
    worn      whose markers are named, one set or those that several subjects wear; known once `name` has ended
    named_by  the same with only the joints that they are named by, which `worn` may have more than
    trial     for what else of its file goes into the named one; None where there is nothing, or it is not wanted
    """

    keys: tuple[str, ...]
    mend: str
    in_parts = False
    long: bool | None = None
    cameras: Cameras = NO_CAMERAS
    worn: Worn
    named_by: Worn
    trial: TrialFile | TextHead | None = None

    def __init__(self, job: LabelJob, models: dict[str, Model], stack: ExitStack, clock: dict[str, float]):
        self.job, self.stack, self.clock = job, stack, clock
        self.model, self.several = models[job.models[0]], None
        if job.several:
            if job.body is not None:
                raise InputError("a body of your own is one subject's; expected the bodies of the models", job.source)
            subjects = tuple(Wearer(name, models[worn]) for name, worn in job.wearers)
            self.several = SeveralOptions(subjects=subjects) if subjects else SeveralOptions(self.model, job.subjects)
        self.rate = job.frame_rate
        known = self.read()
        named = self.several.possible if self.several else self.model.markerset
        self.edits = open_edits(job.edits_applied, job.source, named, **known)

    @cached_property
    def lab(self) -> LabRecords:
        """What its file records beside points, which only somebody who sees the take looks at."""
        if isinstance(self.trial, TextHead):
            return LabRecords(0, self.trial.events)
        return NO_LAB if self.trial is None else read_lab(self.trial, self.rate)

    def rays(self) -> "MarkerRays | None":
        """Those of the markers that one camera alone sees; None where no camera is known."""
        return None
