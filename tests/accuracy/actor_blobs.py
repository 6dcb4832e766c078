# SPDX-License-Identifier: GPL-3.0-or-later
"""Two and three people seen by cameras, one often behind the other: python -m tests.accuracy.actor_blobs.

Walkers of McGill in the recorded room vicon12, seen by eight of its twelve cameras, 0.5 m apart: passing each other, or
side by side all the time. `behind` is side by side in eight made-up cameras on one side, from which one walks behind
the other. All real bodies, which the model knows nothing of, are in the way of all markers. The model of body26 was
learned from five others. A blob with the wrong person's name is wrong. `one` is one walker in the same room by the same
method, and by the usual one. Each take is also labelled as one person's: `told` counts those of which it is then said
how to ask for all. In `returning` the second of two who walk side by side leaves for the middle third of the take, and
comes back at the other side of the first. `ann` and `ann-beside` are pairs of whom the first alone is asked for, by a
model learned from a turn of their own; a blob of the other one that is named is wrong. With --keep DIR, models are kept
there and used again.
"""

import argparse
from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import permutations
from pathlib import Path
from time import process_time

import numpy as np

from addon.core.blobs.pipeline import Options, label_take
from addon.core.data.errors import JobError
from addon.core.data.progress import finished
from addon.core.data.takes import Blobs, LabelledChunk
from addon.core.geometry.cameras import Cameras
from addon.core.pipelines.others import OtherSubjects
from addon.core.pipelines.several_through_points import label_several_blobs
from addon.core.pipelines.through_points import label_through_points
from addon.core.points.models import Model
from addon.core.points.refusals import SubjectsError
from addon.core.points.several.wearers import AUTO, SeveralOptions, Wearer
from addon.core.points.whole_take.pipeline import USUAL_TARGET, PointOptions
from addon.core.simulation.rigs import ring_rig
from addon.core.simulation.simulate import BodiesTogether, CaptureOptions, capture, joined

from .actors import PASSING_M, Meeting, middle_of, own_turn, passing, returning
from .flesh import flesh
from .people import BODY26
from .tables import share, table
from .walking import room_middle, vicon12
from .whole_takes import Take, case_few, model_of

CAMERAS = 8
RING = 24  # of which eight that are next to each other are on one side, a third of the way round
ONE_SIDE = ring_rig(RING, (1280, 1024), 4.5, 1.2, 1.8)
RATE = 60.0
CHUNK = 256


@dataclass(frozen=True, eq=False)
class Seen:
    """What cameras saw of a meeting, with the true names of all blobs: 1:LASI, 2:LASI …, several joined with `|`."""

    cameras: Cameras
    blobs: Blobs
    truth: np.ndarray
    hidden_by_others: float

    def chunks(self) -> Iterator[tuple[Blobs, float]]:
        """The blobs chunk by chunk."""
        first, last = int(self.blobs.frames[0]), int(self.blobs.frames[-1])
        for start in range(first, last + 1, CHUNK):
            yield self.blobs.between(start, min(start + CHUNK - 1, last)), (start - first) / (last + 1 - first)


def at_60(take: Take) -> Take:
    """The take at 60 Hz, linear between the samples."""
    at = np.arange(int((len(take.xyz) - 1) * RATE / take.rate) + 1) * take.rate / RATE
    before = np.minimum(at.astype(int), len(take.xyz) - 2)
    part = (at - before)[:, None, None]
    return replace(take, xyz=take.xyz[before] * (1 - part) + take.xyz[before + 1] * part, rate=RATE)


def meetings(kind: str) -> Iterator[Meeting]:
    """Strangers of McGill: `passing`, `beside` or `behind`, `three` who pass each other, `one`, or one `returning`."""
    if kind == "returning":
        yield from returning(meetings("beside"))
        return
    for case in case_few("body26", BODY26, False):
        count = {"one": 1, "three": 3}.get(kind, 2)
        groups = [case.tested[first : first + count] for first in range(len(case.tested) - count + 1)]
        for group in groups[:: 2 if count == 1 else 1]:
            some = [at_60(one) for one in group]
            lanes = [PASSING_M * index for index in range(count)]
            ways = [(-1) ** index if kind in ("passing", "three") else 1 for index in range(count)]
            yield Meeting(" ".join(one.subject for one in some), passing(some, lanes, ways), case)


def seen(meeting: Meeting, seed: int, one_side: bool = False) -> Seen:
    """The meeting in the room, or in front of eight cameras on `one_side`."""
    generator = np.random.default_rng([17, seed])
    centre = np.append(np.mean([middle_of(one.xyz)[len(one.xyz) // 2] for one in meeting.people], axis=0), 0.0)
    if one_side:
        cameras = ONE_SIDE.select(np.sort(np.argsort(ONE_SIDE.centres[:, 1])[:CAMERAS]))
        placed = [one.xyz - centre for one in meeting.people]
    else:
        cameras, placed = _in_room(meeting, centre, generator)
    bodies = tuple(flesh(one.markers, xyz) for one, xyz in zip(meeting.people, placed, strict=True))
    together = BodiesTogether(bodies, tuple(xyz.shape[1] for xyz in placed))
    names = meeting.together().markers
    options = replace(CaptureOptions(), seed=int(generator.integers(2**31)))
    xyz = np.concatenate(placed, axis=1)
    taken = joined(capture(xyz, names, cameras, options, together))
    return Seen(cameras, taken.blobs, taken.truth, _hidden_by_others(bodies, placed, cameras))


def _in_room(meeting: Meeting, centre: np.ndarray, generator: np.random.Generator) -> tuple[Cameras, list[np.ndarray]]:
    """The cameras and the people on the way on which eight cameras see most of it."""
    room, middle = vicon12(), room_middle()
    best = None
    for yaw in generator.uniform(0, 2 * np.pi) + np.arange(0, 2 * np.pi, 0.3):
        cos, sin = np.cos(yaw), np.sin(yaw)
        turn = np.array([[cos, -sin, 0], [sin, cos, 0], [0, 0, 1]])
        placed = [(one.xyz - centre) @ turn.T + middle for one in meeting.people]
        pixels = room.project(np.concatenate(placed, axis=1)[::5])
        with np.errstate(invalid="ignore"):
            inside = ((pixels >= 0) & (pixels < room.size[:, None, None])).all(axis=-1).mean(axis=(1, 2))
        total = np.sort(inside)[-CAMERAS:].sum()
        best = (total, placed, inside) if best is None or total > best[0] else best
    _, placed, inside = best
    return room.select(np.sort(np.argsort(-inside)[:CAMERAS])), placed


def _hidden_by_others(bodies: tuple, placed: list[np.ndarray], cameras: Cameras) -> float:
    """The share of what a person's own body lets a camera see that somebody else hides from it; some frames."""
    lost = there = 0
    for frame in range(0, len(placed[0]), 10):
        at = slice(frame, frame + 1)
        for index, xyz in enumerate(placed):
            free = ~bodies[index].hidden(at, xyz[at], cameras.centres)
            for other, body in enumerate(bodies):
                if other != index:
                    lost += int((free & body.hidden(at, xyz[at], cameras.centres)).sum())
            there += int(free.sum())
    return lost / max(there, 1)


@dataclass
class Tally:
    """Blobs named, wrong, and of markers; and of what people there were."""

    name: str
    given: int = 0
    wrong: int = 0
    person: int = 0
    there: int = 0
    takes: int = 0
    refused: int = 0
    right_number: int = 0
    told: int = 0
    frames: int = 0
    spent: float = 0.0
    behind: float = 0.0

    def add(self, names: np.ndarray, truth: np.ndarray, people: int):
        """Counts a take, with the numbers of people that go best with it in all of it; of one, the first's blobs."""
        best = None
        for order in permutations(range(1, people + 1)):
            called = {str(number): str(other) for number, other in enumerate(order, 1)}
            named = [called.get(n.partition(":")[0], "?") + ":" + n.partition(":")[2] if n else "" for n in names]
            wrong = [n for n, t in zip(named, truth, strict=True) if n and n not in t.split("|")]
            if best is None or len(wrong) < best[0]:
                pairs = zip(named, truth, strict=True)
                own = sum(bool(n and t) and n[:2] not in {one[:2] for one in t.split("|")} for n, t in pairs)
                best = len(wrong), own
        self.wrong += best[0]
        self.person += best[1]
        self.given += int(sum(map(bool, names)))
        self.there += sum(bool(t) and (people > 1 or "1:" in t) for t in truth)

    def row(self) -> list[str]:
        """A line of the table."""
        recall = f"{100 * (self.given - self.wrong) / max(self.there, 1):.2f} %"
        wrong = share(self.wrong, self.given, 3) if self.given else "–"
        counts = str(self.takes), f"{100 * self.behind / max(self.takes, 1):.0f} %"
        number = f"{self.right_number} of {self.takes}"
        pace = f"{self.frames / max(self.spent, 1e-9):.0f}"
        told = f"{self.told} of {self.takes}"
        return [self.name, *counts, recall, wrong, str(self.person), str(self.refused), number, told, pace]


def is_told(shot: Seen, model: Model) -> bool:
    """Whether a take of which one subject is asked says how to ask for all."""
    others = OtherSubjects(shot.cameras, model)
    parts = [part for part, _ in shot.chunks()]
    for blobs, chunk in zip(parts, label_take(parts, shot.cameras, model.markerset, RATE), strict=True):
        others.add(blobs, chunk)
    try:
        others.refuse()
    except SubjectsError:
        return True
    return False


def several(shot: Seen, asked: SeveralOptions) -> tuple[Iterator[LabelledChunk], tuple[str, ...], int]:
    """The labelled chunks of whoever is asked for, their markers, and how many they are."""
    made = finished(label_several_blobs(shot.chunks, shot.cameras, asked, PointOptions("likelihood"), RATE))
    return made.chunks(part for part, _ in shot.chunks()), made.worn.markers, len(made.worn.subjects)


def run(meeting: Meeting, model: Model, seed: int, way: str, auto: bool, into: Tally, show: bool):
    """Labels a meeting, and counts what came of it."""
    shot, people = seen(meeting, seed, into.name == "behind"), len(meeting.people)
    names, found, reason = np.full(len(shot.blobs), "", object), 0, ""
    begin = process_time()
    try:
        if way == "several":
            asked = SeveralOptions(model=model, count=AUTO if auto else people)
            chunks, markers, found = several(shot, asked)
        elif way == "ann":
            people = 1
            chunks, markers, found = several(shot, SeveralOptions(subjects=(Wearer("1", model),)))
        else:
            markers, found = tuple(f"1:{name}" for name in model.markerset.markers), 1
            parts = (part for part, _ in shot.chunks())
            if way == "fit":
                chunks = label_take(parts, shot.cameras, model.markerset, RATE)
            else:
                given = "likelihood", RATE, Options(), USUAL_TARGET
                chunks = label_through_points(parts, shot.cameras, model, *given)
        marker = np.concatenate([chunk.labels.marker for chunk in chunks])
        names[marker >= 0] = np.array(markers, object)[marker[marker >= 0]]
    except JobError as error:
        reason = str(error)
    into.spent += process_time() - begin
    into.told += is_told(shot, model)
    into.frames += len(shot.blobs.frames)
    into.takes += 1
    into.refused += bool(reason)
    into.right_number += found == people
    into.behind += shot.hidden_by_others
    before = into.given, into.wrong, into.there, into.person
    into.add(names, shot.truth, max(people, found))
    if show:
        given, wrong, there, person = (
            new - old for new, old in zip((into.given, into.wrong, into.there, into.person), before, strict=True)
        )
        said = f"{len(shot.blobs.frames)} frames, {shot.hidden_by_others:.2f} behind, {given - wrong} of {there}"
        print(f"  {into.name} {meeting.name}: {found} found, {said}, {wrong} wrong, {person} {reason}", flush=True)


KINDS = {
    "passing": ("passing", "several"),
    "beside": ("beside", "several"),
    "behind": ("behind", "several"),
    "three": ("three", "several"),
    "returning": ("returning", "several"),
    "ann": ("passing", "ann"),
    "ann-beside": ("beside", "ann"),
    "one": ("one", "points"),
    "one-fit": ("one", "fit"),
}


def main():
    """Prints the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("kinds", nargs="*", help=f"of {' '.join(KINDS)}; all unless said")
    parser.add_argument("--keep", type=Path, help="a folder for the models")
    parser.add_argument("--auto", action="store_true", help="do not say how many there are")
    parser.add_argument("--most", type=int, default=100, help="takes of a kind")
    parser.add_argument("--show", action="store_true", help="take by take")
    given = parser.parse_args()
    done = []
    for kind in given.kinds or KINDS:
        own, models = Tally(kind), {}
        title, way = KINDS[kind]
        for seed, meeting in enumerate(meetings(title)):
            if seed < given.most:
                case = own_turn(meeting.people[0].subject) if way == "ann" else meeting.training
                if case is None:
                    continue  # a turn that lacks a marker
                models = {case.name: models.get(case.name) or model_of(case, given.keep)}
                run(meeting, models[case.name], seed, way, given.auto, own, given.show)
        done.append(own)
        print(own.row(), flush=True)
    columns = ["people", "takes", "hidden by others", "recall", "wrong labels", "other person's", "refused"]
    print(table([*columns, "right number", "told", "frames/s"], [one.row() for one in done]))


if __name__ == "__main__":
    main()
