# SPDX-License-Identifier: GPL-3.0-or-later
"""Names from a stream: a line for each frame at once and, where wanted, all frames in a C3D at the end."""

from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from time import perf_counter
from typing import Any, Protocol

import numpy as np
from threadpoolctl import threadpool_limits

from ..core.body.bodies import Bodies, BodyModel
from ..core.data.errors import InputError, UserError
from ..core.data.takes import NO_MARKER, Points
from ..core.points.models import Model
from ..core.points.several.live import namer_of, solved_of_several
from ..core.points.several.wearers import AUTO, SetsWorn, Wearer
from ..core.points.whole_take.live import LiveNamer, Window, WindowNames, solved_window, subject_in
from ..core.posing.finer import finer
from ..core.posing.posing import FollowedBody
from ..core.reconstruction.trajectories import Reconstructed
from ..io.c3d.writing import MAX_POINTS
from ..io.markersets import AUTO_MODEL
from ..io.models import open_model
from ..io.points import write_c3d
from ..io.scratch import scratch_folder
from ..io.streams.sources import open_stream
from ..io.streams.wire import LiveStream, StreamFrame, believed
from ..io.whole import whole_file
from .rebuild import TrajectoryFile

RATE_FRAMES = 30  # by which the frame rate is known where the sender does not say
KEPT_FRAMES = 200  # that go to the disk at once


class Beside(Protocol):
    """Another process that works while frames go on."""

    busy: bool

    def hand(self, work: Callable):
        """Hands it a work, if it is not `busy`."""

    def look(self) -> Any:
        """What came of it, such as trouble; None while it is at work."""


@dataclass(frozen=True)
class LiveJob:
    """What to name."""

    source: str  # the address of a stream
    model: str  # a built-in model's name or the path of one
    out: Path | None = None  # the `.c3d` to write at the end, None for none
    up: str | None = None  # the axis that points up in the sender's world, None for what it says
    rate: float | None = None  # frames a second, None for what the sender says or shows
    wait: float = 5.0  # s without a frame after which the stream has ended in trouble
    anywhere: bool = False  # also a sender outside of this machine's own network
    overwrite: bool = False
    subjects: int = 1  # how many wear it; of several all markers are called 1:LASI, 2:LASI
    # who wears what instead, each a name and a model; markers are then called NAME:LASI
    wearers: tuple[tuple[str, str], ...] = ()

    @property
    def several(self) -> bool:
        """Whether markers are called by who wears them."""
        return self.subjects != 1 or bool(self.wearers)

    @property
    def worn(self) -> SetsWorn:
        """Who wears what, by numbers where they have no names; InputError where a model has learned nothing."""
        if self.subjects == AUTO:
            words = "as many as there are is for a whole take to say"
            raise InputError(f"{words}; expected how many subjects are in the stream")
        if self.model == AUTO_MODEL:
            raise InputError("auto needs the whole take; expected a built-in model or a *.markerset.json file")
        each = self.wearers or tuple((str(number + 1), self.model) for number in range(self.subjects))
        models = {name: _open(name) for name in dict.fromkeys(model for _, model in each)}
        return SetsWorn(tuple(Wearer(name, models[model]) for name, model in each))

    @property
    def called(self) -> dict[str, dict[str, str]]:
        """By who wears them, or else by the model, its markers, and what lines call each."""
        every = {}
        for one in self.worn.subjects:
            own = one.model.markerset
            name, called = (one.name, one.markers) if self.several else (own.name, own.markers)
            every[name] = dict(zip(own.markers, called, strict=True))
        return every


def _open(name: str) -> Model:
    model = open_model(name)
    if model.likelihood is None or not model.has_learned:
        words = "is learned from nobody, by whom frames could be named"
        raise InputError(f"{words}; expected a trained model", name)
    return model


class LiveFile(TrajectoryFile):
    """All frames of a stream, in a scratch file: the markers' columns first, then what stayed without a name."""

    def __init__(self, folder: Path, rate: float, names: tuple[str, ...]):
        super().__init__(folder, rate)
        self.names = names
        self.spans.table = np.tile([0, np.iinfo(np.int64).max, -1], (len(names), 1))
        self.waiting: list[tuple[int, np.ndarray, np.ndarray]] = []

    def keep(self, row: int, points: np.ndarray, marker: np.ndarray, trajectory: np.ndarray):
        """Keeps the points (P, 3) m of a frame, a marker or else a trajectory each (P,)."""
        self.waiting.append((row, points, np.where(marker == NO_MARKER, len(self.names) + trajectory, marker)))
        if len(self.waiting) >= KEPT_FRAMES:
            self.put()

    def put(self):
        """Writes what is waiting; where there is no room it is lost, and what was written before it is not."""
        waiting, self.waiting = self.waiting, []
        if not waiting:
            return
        first = len(self.counts)
        frames = np.arange(first, waiting[-1][0] + 1)
        frame = np.repeat([row - first for row, *_ in waiting], [len(points) for _, points, _ in waiting])
        points, which = (np.concatenate([part[at] for part in waiting]) for at in (1, 2))
        nothing = np.full(len(points), np.nan)
        self.add(Reconstructed(frames, frame, which, points, nothing, np.zeros((len(points), 0)), 0.0))

    def take(self, first_frame: int) -> Points:
        """The whole take as far as it is written, its first frame called so."""
        points = self.points()
        names = (*self.names, *[""] * (len(points.names) - len(self.names)))
        return replace(points, names=names, first_frame=first_frame)

    def _columns(self) -> np.ndarray:
        own = len(self.names)
        column = np.full(len(self.spans.table), -1)
        column[:own] = np.arange(own)
        rest = own + np.flatnonzero(self.spans.table[own:, 0])
        column[rest] = own + self.shared(rest, MAX_POINTS - own)
        return column


def name_stream(
    job: LiveJob,
    beside: Beside,
    tell: Callable[[dict], None],
    stopped: Callable[[], bool],
    recording: Callable[[], bool] = lambda: True,
    posed: bool = False,
) -> dict:
    """Names frames until the sender ends, or somebody has `stopped` it; `tell` hears each. Gives what there is to say.

    Windows are solved in a process beside this one. From when it is `recording` on all frames are kept; lines have
    bodies where those are `posed`. Raises UserError where the stream ends in trouble; what came until then is kept.
    """
    worn = job.worn
    if job.out is not None and job.out.suffix.lower() != ".c3d":
        raise InputError("is no file of 3D points; expected a name that ends in .c3d", job.out)
    with ExitStack() as stack:
        target = stack.enter_context(whole_file(job.out, job.overwrite)) if job.out else None
        folder = stack.enter_context(scratch_folder()) if job.out else None
        stream = stack.enter_context(open_stream(job.source, job.up or "", job.wait, job.anywhere))
        live = _Live(job, stream, beside, posed, worn, folder, stack, recording)
        trouble = live.run(tell, stopped)
        if target is not None and live.file is not None and live.file.counts:
            names = [one.name for one in worn.subjects] if job.several else []
            write_c3d(target, live.file.take(live.first), subjects=names)
        elif trouble is not None:
            raise trouble
    if trouble is not None:
        raise trouble
    return {"frames": live.frames, "late": live.late, "rate": live.rate, "out": str(job.out) if live.file else None}


def solved(job: LiveJob, posed: bool, window: Window) -> WindowNames:
    """What the process beside does with a window; where bodies are `posed` it also says whose names they are."""
    with threadpool_limits(1, user_api="blas"):
        worn = job.worn
        models = [one.model for one in worn.subjects]
        names = solved_of_several(worn.subjects, window) if job.several else solved_window(models[0], window)
        if not posed:
            return names
        own = zip(models, worn.firsts, strict=True)
        return replace(names, subjects=tuple(subject_in(model, window, names.marker - first) for model, first in own))


class _PosedSubject:
    """One of those who are in a stream, by what is named of theirs.

    model   the body of what is worn
    own     the rows of its markers among all
    body    who it is, None where that is not known yet
    shown   samples that were named in the window that `body` is of; none where it may be somebody else by now
    """

    def __init__(self, wearer: Wearer, first: int):
        self.model = BodyModel(finer(wearer.model.markerset))
        self.own = slice(first, first + self.model.marker_count)
        self.body: FollowedBody | None = None
        self.shown = 0

    def know(self, window: Window, marker: np.ndarray, subject: Bodies | None):
        """Takes who it is from a window with more samples named (L,) than the last one, or where names were wrong."""
        named = (self.own.start <= marker) & (marker < self.own.stop)
        samples = int(np.isfinite(window.xyz[:, named, 0]).sum())
        if subject is not None and samples > self.shown:
            self.shown, self.body = samples, FollowedBody(self.model, subject)

    def pose(self, places: np.ndarray) -> dict | None:
        """The body on all markers (M, 3) m of a frame: joints, rotations, scale; None where too few are there."""
        places = places[self.own]
        if np.isnan(places).all():
            self.shown = 0  # who is found then may be somebody else
        if self.body is None or (posed := self.body.pose(places)) is None:
            return None
        parts = {"joints": posed.joints[0], "rotations": posed.rotations[0], "scale": self.body.subject.scale[0]}
        return {name: part.round(5).tolist() for name, part in parts.items()}


@dataclass
class _Live:
    """A stream that is being named."""

    job: LiveJob
    stream: LiveStream
    beside: Beside
    poses: bool
    worn: SetsWorn
    folder: Path | None
    stack: ExitStack
    recording: Callable[[], bool]

    def __post_init__(self):
        job, worn = self.job, self.worn
        self.names = worn.markers if job.several else worn.subjects[0].model.markerset.markers
        self.rate = job.rate or self.stream.rate
        self.frames, self.late, self.first, self.kept_from = 0, 0, 0, 0
        self.waiting: list[tuple[float, StreamFrame]] = []
        self.namer: LiveNamer | None = None
        self.file: LiveFile | None = None
        self.posed = list(map(_PosedSubject, worn.subjects, worn.firsts))
        self.asked: Window | None = None  # the last one, and what came of the last that was solved
        self.heard: WindowNames | None = None

    def run(self, tell: Callable[[dict], None], stopped: Callable[[], bool]) -> Exception | None:
        """Names and keeps frames until they end, or somebody has `stopped` it; gives the trouble that they end in."""
        trouble: Exception | None = None
        try:
            for frame in self.stream:
                if (line := self.line(frame)) is not None:
                    tell(line)
                self.ask()
                if stopped():
                    break
        except (UserError, OSError) as error:
            trouble = error
        try:
            if self.file is not None:
                self.file.put()
        except UserError as error:
            trouble = trouble or error
        return trouble

    def line(self, frame: StreamFrame) -> dict | None:
        """What a frame comes to; None where the next is there already, which is told instead."""
        came = perf_counter()
        self.frames += 1
        marker, renamed = np.full(len(frame.points), NO_MARKER), []
        if self.namer is None:
            self.waiting.append((came, frame))
            self._begin()
        else:
            answer = self.beside.look() if self.beside.busy else None
            if isinstance(answer, UserError):
                raise answer
            if answer is not None:
                self.namer.hear(answer)
                self.heard = answer
            marker = self._named(self.namer, frame)
            self._know(self.namer.renamed, answer is not None)
            renamed = [[self.names[old], self.names[new] if new >= 0 else None] for old, new in self.namer.renamed]
        if self.stream.behind and not renamed:
            self.late += 1
            return None
        places = np.round(frame.points, 4).tolist()
        pairs = list(zip(marker.tolist(), places, strict=True))
        return self._bodies(frame.points, marker) | {
            "frame": frame.number,
            "seconds": round(frame.seconds, 6) if np.isfinite(frame.seconds) else None,
            "markers": {self.names[one]: place for one, place in sorted(pairs) if one != NO_MARKER},
            "unnamed": [place for one, place in pairs if one == NO_MARKER],
            "renamed": renamed,
            "late": self.late,
            "ms": round(1000 * (perf_counter() - came), 2),
        }

    def ask(self):
        """Hands over the last moment to be solved."""
        if self.namer is not None and not self.beside.busy and (window := self.namer.window()) is not None:
            self.asked = window
            self.beside.hand(partial(solved, self.job, self.poses, window))

    def _know(self, renamed: list[tuple[int, int]], is_new: bool):
        """Takes who they are from the last window that was solved, if it is new or names of theirs were wrong."""
        for one in self.posed:
            if any(one.own.start <= marker < one.own.stop for names in renamed for marker in names):
                one.shown = 0
        if (is_new or renamed) and self.heard is not None and self.asked is not None:
            for one, subject in zip(self.posed, self.heard.subjects, strict=False):
                one.know(self.asked, self.heard.marker, subject)

    def _bodies(self, points: np.ndarray, marker: np.ndarray) -> dict:
        """Of each subject the body on points (P, 3) m that are markers (P,); nothing where nobody is known."""
        if all(one.body is None for one in self.posed):
            return {}
        named, places = marker != NO_MARKER, np.full((len(self.names), 3), np.nan)
        places[marker[named]] = points[named]
        return {"bodies": [one.pose(places) for one in self.posed]}

    def _begin(self):
        """Begins to name once the frame rate is known."""
        if not self.rate and len(self.waiting) >= RATE_FRAMES:
            (begin, first), (end, last) = self.waiting[0], self.waiting[-1]
            seconds = last.seconds - first.seconds
            seconds = seconds if seconds > 0 else end - begin  # not so where it is no number
            self.rate = believed(abs(last.number - first.number) / seconds)
            if not self.rate:  # it began anew, or its numbers jump: by later ones
                self.waiting.pop(0)
        if self.rate:
            self.namer = namer_of([one.model for one in self.worn.subjects], self.rate)
            for _, frame in self.waiting:
                self._named(self.namer, frame)
            self.waiting = []

    def _named(self, namer: LiveNamer, frame: StreamFrame) -> np.ndarray:
        marker, trajectory = namer.name(frame.number, frame.points, frame.ids)
        if self.file is None and self.folder is not None and self.rate and self.recording():
            self.file = self.stack.enter_context(LiveFile(self.folder, self.rate, self.names))
            self.first, self.kept_from = frame.number, namer.row
        if self.file is not None:
            self.file.keep(namer.row - self.kept_from, frame.points, marker, trajectory)
        return marker
