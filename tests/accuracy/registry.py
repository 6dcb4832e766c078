# SPDX-License-Identifier: GPL-3.0-or-later
"""Every case that naming is measured on, as takes labelled one by one: blobs and points, one person and several.

Nobody who is labelled is in the training of the model that names them, unless the case says "own" or "frame". Takes of
other labs are made by ../shared/tools/peers/strangers.py into the folder of models.
"""

import subprocess
import sys
from collections.abc import Callable, Iterator
from collections.abc import Set as AbstractSet
from dataclasses import dataclass, replace
from functools import partial
from itertools import islice, permutations
from pathlib import Path
from time import process_time

import numpy as np

from addon.cli.evaluate import compare
from addon.core.data.errors import JobError, UserError
from addon.core.data.progress import finished
from addon.core.data.takes import Points
from addon.core.evaluation.figures import Figures
from addon.core.pipelines.blobs import BlobOptions, label_blobs
from addon.core.points.models import Model
from addon.core.points.several.pipeline import label_several
from addon.core.points.several.wearers import AUTO, SeveralOptions, Wearer
from addon.core.points.whole_take.pipeline import PointOptions, label_take
from addon.core.simulation.simulate import CaptureOptions
from addon.core.training.takes import LabelledTake
from addon.io.models import open_model, write_model
from addon.io.points import read_points

from . import actors, people, plates, real_blobs, strangers, whole_takes
from .captures import standing, taken, walking
from .people import left_out_model

PEERS = people.DATA.parent / "tools" / "peers" / "strangers.py"
STANDING = 40  # captures of one frame of each group of left-out people
# Where and by how many cameras walks are seen.
WALKED = {
    "": {},
    " in a ring": {"room": "ring"},
    " in eight": {"cameras": (8, 8)},
    " in eight, drawn again": {"cameras": (8, 8), "seed": 2},
    " in five, noisy": {"cameras": (5, 5), "options": CaptureOptions(noise=1.5)},
    **{f" in a ring of {count}": {"room": "ring", "cameras": (count, count)} for count in (4, 3, 2)},
}
# What is turned up, of standing frames: the paper's four cameras unless another number is said.
CURVES = {
    **{f"{count} cameras": {"cameras": count} for count in range(2, 13)},
    **{f"noise {px:g} px": {"options": CaptureOptions(noise=px)} for px in (0.0, 0.5, 1.0, 1.5, 2.0)},
    **{f"{count} ghosts a camera": {"options": CaptureOptions(reflections=count)} for count in range(6)},
    **{f"markers off {mm} mm": {"options": CaptureOptions(marker_offset=mm / 1000)} for mm in (0, 10, 20, 30, 40)},
    **{
        f"cameras off {mm} mm": {"options": CaptureOptions(calibration_mm=mm, calibration_mrad=0.2 * mm)}
        for mm in range(6)
    },
}
CURVE = 8  # captures of each group of left-out people
SHORT = 600  # frames of a part of a take
DRAWS = 20  # of each stranger's single frame


@dataclass(frozen=True, eq=False)
class Outcome:
    """What came of a take: right and wrong labels, and markers there, by second (S,); why refused; core seconds."""

    right: np.ndarray
    wrong: np.ndarray
    there: np.ndarray
    refused: str
    seconds: float


@dataclass(frozen=True, eq=False)
class Trial:
    """One take of a case, ready to be labelled."""

    take: str
    label: Callable[[], Outcome]


def by_second(given: np.ndarray, right: np.ndarray, there: np.ndarray, second: np.ndarray) -> tuple[np.ndarray, ...]:
    """Right and wrong labels, and markers, of points (N,) that lie in some second of the take."""
    count = int(second.max(initial=0)) + 1
    return tuple(np.bincount(second[some], minlength=count) for some in (given & right, given & ~right, there))


def of_points(marker: np.ndarray, truth: np.ndarray, rate: float, refused: str, seconds: float) -> Outcome:
    """The outcome of markers (T, P) given, -1 for none."""
    second = np.broadcast_to((np.arange(len(truth)) / rate).astype(int)[:, None], truth.shape).ravel()
    given = (marker >= 0).ravel()
    return Outcome(*by_second(given, (marker == truth).ravel(), (truth >= 0).ravel(), second), refused, seconds)


def of_blobs(names, truth, frame, rate: float, seconds: float, refused: str = "") -> Outcome:
    """The outcome of names (N,) of blobs, "" for none; the truth may name several, joined with `|`."""
    second = ((frame - frame.min(initial=0)) / rate).astype(int) if len(frame) else np.zeros(0, int)
    right = np.array([name in true.split("|") for name, true in zip(names, truth, strict=True)], bool)
    given, there = np.array([bool(name) for name in names]), np.array([bool(true) for true in truth])
    return Outcome(*by_second(given, right, there, second), refused, seconds)


def timed(naming: Callable[[], np.ndarray], nothing: np.ndarray) -> tuple[np.ndarray, str, float]:
    """What a naming gives, or nothing and why it refuses, and the seconds of a core."""
    begin, refused = process_time(), ""
    try:
        given = naming()
    except JobError as error:
        given, refused = nothing, str(error)
    return given, refused, process_time() - begin


def labelled_points(points: Points, truth: np.ndarray, model: Model) -> Outcome:
    """The outcome of a take of one subject."""
    work = label_take(points, model, PointOptions("likelihood"))
    marker, refused, seconds = timed(lambda: finished(work).whole().labels.marker, np.full(points.xyz.shape[:2], -1))
    return of_points(marker, truth, points.rate, refused, seconds)


def whole(name: str, keep: Path, parts: int | None = None) -> Iterator[Trial]:
    """Takes of `whole_takes`, or every part of them that has so many frames."""
    for case in whole_takes.CASES[name]():
        model = whole_takes.model_of(case, keep)
        tested = whole_takes.in_parts(case, parts).tested if parts else case.tested
        for seed, take in enumerate(tested):
            points, truth = whole_takes.anonymous(take, case.markers, case.how, seed)
            title = f"{case.name} {take.subject}" + f" {seed}" * bool(parts)
            yield Trial(title, partial(labelled_points, points, truth, model))


def on_plates(keep: Path) -> Iterator[Trial]:
    """Another take of who was learned from, in 62 markers on plates, cut in three ways."""
    model = people.kept(keep / "plates.markerset.json", lambda: taught([plates.TRAINED]))
    take = read_points(plates.TESTED)
    for tracklets, hidden, ghosts in plates.CUTS:
        xyz, column = plates.cut_up(take.xyz, tracklets, hidden, ghosts, np.random.default_rng(plates.SEED))
        points, truth = whole_takes.without_names(xyz, take.rate), np.where(np.isfinite(xyz[..., 0]), column, -1)
        yield Trial(f"{tracklets} pieces", partial(labelled_points, points, truth, model))


def together(kind: str, keep: Path, most: int, auto: bool = False) -> Iterator[Trial]:
    """Several people in one take of points."""
    for seed, meeting in enumerate(islice(actors.MEETINGS[kind](), most)):
        take, hidden = meeting.together(), actors.HIDDEN_EACH * len(meeting.people)
        points, truth = whole_takes.anonymous(take, take.markers, whole_takes.Pieces(hidden, actors.GHOSTS), seed)
        models = [whole_takes.model_of(one, keep) for one in meeting.own or (meeting.training,)]
        asked = SeveralOptions(model=models[0], count=AUTO if auto else len(meeting.people))
        if meeting.own:
            asked = SeveralOptions(subjects=tuple(Wearer(str(at), model) for at, model in enumerate(models)))
            truth = np.where(truth < sum(len(model.markerset) for model in models), truth, -1)
        title = "auto " * auto + meeting.name
        yield Trial(title, partial(_several, points, truth, asked, len(meeting.people)))


def _several(points: Points, truth: np.ndarray, asked: SeveralOptions, people_there: int) -> Outcome:
    """Which number is which person is settled once for the whole take, unless they are asked for by name."""
    work = label_several(points, asked, PointOptions("likelihood"))
    given, refused, seconds = timed(lambda: finished(work).labels.marker, np.full(points.xyz.shape[:2], -1))
    if asked.subjects:
        return of_points(given, truth, points.rate, refused, seconds)
    markers = len(asked.model.markerset)
    found = max(people_there, int(given.max(initial=0)) // markers + 1)
    places = (
        np.concatenate([np.arange(markers) + markers * index for index in order] + [[-1]])
        for order in permutations(range(found))
    )
    outcomes = (of_points(place[given], truth, points.rate, refused, seconds) for place in places)
    return min(outcomes, key=lambda outcome: outcome.wrong.sum())


def together_in_images(kind: str, keep: Path, most: int, first_alone: bool = False) -> Iterator[Trial]:
    """Strangers in eight cameras, or the first of them asked for by name, learned from a turn of their own."""
    for seed, meeting in enumerate(islice(actors.meetings(kind), most)):
        case = actors.own_turn(meeting.people[0].subject) if first_alone else meeting.training
        if case is None:
            continue  # a turn that lacks a marker
        shot, model = actors.seen(meeting, seed, kind == "behind"), whole_takes.model_of(case, keep)
        asked = SeveralOptions(model=model, count=len(meeting.people))
        if first_alone:
            own = np.array([true if "1:" in true else "" for true in shot.truth], object)
            shot, asked = replace(shot, truth=own), SeveralOptions(subjects=(Wearer("1", model),))
        count = 1 if first_alone else len(meeting.people)
        yield Trial(meeting.name, partial(_several_in_images, shot, asked, count))


def _several_in_images(shot: people.Trial, asked: SeveralOptions, count: int) -> Outcome:
    names, refused, seconds = timed(lambda: actors.named(shot, asked), np.full(len(shot.blobs), "", object))
    outcomes = []
    for order in permutations(range(1, count + 1)):
        called = {str(number): str(other) for number, other in enumerate(order, 1)}
        own = [called.get(n.partition(":")[0], "?") + ":" + n.partition(":")[2] if n else "" for n in names]
        outcomes.append(of_blobs(own, shot.truth, shot.blobs.frame, shot.rate, seconds, refused))
    return min(outcomes, key=lambda outcome: outcome.wrong.sum())


def in_images(trials: Callable, name: str, count: int | None, keep: Path | None = None, **more) -> Iterator[Trial]:
    """Captures of left-out people, as `trials(markers, people, count, seed, …)` makes them.

    Of takes, which are asked about in space, the others teach a likelihood, too; it is kept in a folder.
    """
    for fold in people.folds():
        model = Model(left_out_model(name, fold))
        if keep is not None:
            file, teach = keep / f"{name}-without-{'-'.join(fold)}.json", partial(without, name, fold)
            model = replace(people.kept(file, teach), markerset=model.markerset)
        for trial in trials(model.markerset.markers, fold, count, **{"seed": 1, **more}):
            yield Trial(trial.title, partial(_in_image, trial, model))


def without(name: str, left_out: tuple[str, ...]) -> Model:
    """The model of a built-in set's markers that all takes of other walkers teach."""
    takes = people.takes([one for one in people.WALKERS if one not in left_out], *people.KINDS)
    known = [LabelledTake(take.name, take.subject, take.markers, take.xyz) for take in takes]
    return whole_takes.learned(name, known, left_out_model(name, left_out).markers)


def of_strangers(name: str, count: int, chosen_on: bool = False) -> Iterator[Trial]:
    """Single frames of people of other labs, or those that numbers of the search were chosen on."""
    for title, left_out, trials in strangers.cases(chosen_on, count):
        model = Model(left_out_model(name, left_out))
        for trial in trials:
            yield Trial(f"{title} {trial.title}", partial(_in_image, trial, model))


def in_a_ring(takes: Iterator[tuple[people.Take, Model]]) -> Iterator[Trial]:
    """The first ten seconds of takes of other labs, as six to eight cameras see those who wear a set."""
    for number, (take, model) in enumerate(takes):
        part = take.part(0, int(10 * take.rate))
        trial = taken(part, model.markerset.markers, np.random.default_rng([7, number]), room="ring")
        yield Trial(take.name, partial(_in_image, trial, model))


def strangers_takes() -> Iterator[tuple[people.Take, Model]]:
    """Takes of actors and others, whose own markers stand for those of `body26`, and that set, learned without them."""
    for take in strangers.in_body26():
        yield take, replace(open_model("body26"), markerset=left_out_model("body26", (take.subject,)))


def takes_of_other_labs(keep: Path) -> Iterator[tuple[people.Take, Model]]:
    """Those who stand in Plug-in Gait, and `body39`."""
    model = open_model("body39")
    for trial in of_other_labs("plugin_gait", keep):
        points, truth = _case(keep / "strangers" / "plugin_gait" / trial.take, model)
        frame, lane = np.nonzero(truth >= 0)
        xyz = np.full((len(truth), len(model.markerset), 3), np.nan)
        xyz[frame, truth[frame, lane]] = points.xyz[frame, lane]
        yield people.Take(trial.take, trial.take, model.markerset.markers, xyz, points.rate), model


def _in_image(trial: people.Trial, model: Model) -> Outcome:
    def labelled() -> np.ndarray:
        (chunk,) = label_blobs([trial.blobs], trial.cameras, model, BlobOptions(trial.rate))
        return np.array([*model.markerset.markers, ""], object)[chunk.labels.marker]

    names, refused, seconds = timed(labelled, np.full(len(trial.blobs), "", object))
    return of_blobs(names, trial.truth, trial.blobs.frame, trial.rate, seconds, refused)


def recorded(keep: Path) -> Iterator[Trial]:
    """Real blobs of eleven cameras, learned from the first half, and without the two cameras that were moved."""
    folder = keep / "real-blobs"
    folder.mkdir(parents=True, exist_ok=True)
    model = folder / "run.markerset.json"
    if not model.exists():
        real_blobs.learn(folder)
    for title, without in (("all cameras", ()), ("without the moved", real_blobs.MOVED)):
        files = real_blobs.recorded(folder / title.replace(" ", "-"), model, without)
        yield Trial(title, partial(_recorded, files, folder / "out"))


def _recorded(files, out: Path) -> Outcome:
    labels, seconds = real_blobs.labelled(files, out)
    rows, figures = [], Figures()
    figures.add = lambda frame, camera, given, truth, step=None: rows.extend(zip(frame, given, truth, strict=True))
    compare(labels, files.truth, figures, real_blobs.TESTED)
    frame, names, truth = zip(*rows, strict=True)
    return of_blobs(names, truth, np.array(frame), files.rate, seconds)


def of_other_labs(kind: str, keep: Path) -> Iterator[Trial]:
    """Takes of people, animals and hands of other labs, by the built-in `body39` or a set of their own."""
    folder = keep / "strangers" / kind
    if not folder.is_dir():
        subprocess.run([sys.executable, PEERS, keep / "strangers", kind], check=True, stdout=subprocess.DEVNULL)
    first = None
    for place in sorted(one for one in folder.iterdir() if one.is_dir()):
        files = sorted(place.glob("train/*/*.c3d"))
        first = place / "own.markerset.json" if files else first
        if first is not None and not first.exists() and files:
            try:
                write_model(first, taught(files))
            except UserError as error:
                yield Trial(place.name, partial(_untaught, place, str(error)))
                continue
        model = open_model("body39" if kind == "plugin_gait" else str(first))
        yield Trial(place.name, partial(_of_other_lab, place, model))


def taught(files: list[Path]) -> Model:
    """The model that files of labelled takes teach."""
    known = []
    for file in files:
        take, really = read_points(file), people.MISLABELLED.get(f"{file.parent.name}_standing", {})
        names = tuple(really.get(name, name) for name in take.names)
        known.append(LabelledTake(file.stem, file.parent.name, names, take.xyz))
    markers = tuple(name for name in known[0].names if all(name in one.names for one in known))
    return whole_takes.learned("own", known, markers)


def of_parts(keep: Path) -> Iterator[Trial]:
    """The strangers of Plug-in Gait with a part of the body alone, or without one."""
    model = open_model("body39")
    leg = {f"{side}{name}" for side in "LR" for name in ("THI", "KNE", "TIB", "ANK", "HEE", "TOE")}
    arm = {f"{side}{name}" for side in "LR" for name in ("UPA", "ELB", "FRM", "WRA", "WRB", "FIN")}
    pelvis, head = {"LASI", "RASI", "LPSI", "RPSI"}, {"LFHD", "RFHD", "LBHD", "RBHD"}
    every = set(model.markerset.markers)
    parts = {
        "pelvis and legs": leg | pelvis,
        "pelvis and left leg": {name for name in leg if name[0] == "L"} | pelvis,
        "all but pelvis and legs": every - leg - pelvis,
        "all but legs": every - leg,
        "all but arms": every - arm,
        "all but the head": every - head,
        "head and trunk": every - leg - arm - pelvis,
        "all but a marker of each wrist, and fingers": every - {"LWRB", "RWRB", "LFIN", "RFIN"},
    }
    for trial in of_other_labs("plugin_gait", keep):
        if trial.take != "btk_two_sets":
            place = keep / "strangers" / "plugin_gait" / trial.take
            for part, worn in parts.items():
                yield Trial(f"{trial.take} {part}", partial(_of_other_lab, place, model, worn))


def of_strangers_takes(how: whole_takes.Pieces | None) -> Iterator[Trial]:
    """Takes of actors and others, whose own markers stand for those of `body26`: whole trajectories or pieces."""
    model = open_model("body26")
    for take in strangers.in_body26():
        points, truth = whole_takes.anonymous(take, model.markerset.markers, how)
        yield Trial(take.name, partial(labelled_points, points, truth, model))


def _case(place: Path, model: Model) -> tuple[Points, np.ndarray]:
    """A case's points, and which marker of the model each is (T, P), -1 where none."""
    points, index = read_points(place / "cloud.c3d"), {name: at for at, name in enumerate(model.markerset.markers)}
    rows = [line.split(",") for line in (place / "truth.csv").read_text(encoding="utf-8").splitlines()[1:]]
    # A piece is one marker's for as long as it lasts.
    of_column = np.full(max(int(column) for _, column, _ in rows) + 1, -1)
    of_column[[int(column) for _, column, _ in rows]] = [index.get(name, -1) for _, _, name in rows]
    frame, lane = np.nonzero(points.present)
    truth = np.full(points.xyz.shape[:2], -1)
    truth[frame, lane] = of_column[points.numbers(points.standing.at(frame, lane))]
    return points, truth


def _of_other_lab(place: Path, model: Model, worn: AbstractSet[str] | None = None) -> Outcome:
    points, truth = _case(place, model)
    if worn is not None:
        away = np.isin(truth, [at for at, name in enumerate(model.markerset.markers) if name not in worn])
        points, truth = replace(points, xyz=np.where(away[..., None], np.nan, points.xyz)), np.where(away, -1, truth)
    return labelled_points(points, truth, model)


def _untaught(place: Path, why: str) -> Outcome:
    there = sum(not line.endswith(",") for line in (place / "truth.csv").read_text(encoding="utf-8").splitlines()[1:])
    return Outcome(np.zeros(1, int), np.zeros(1, int), np.array([there]), f"not learned: {why}", 0.0)


def registry(keep: Path) -> dict[str, Callable[[], Iterator[Trial]]]:
    """The cases by name; each gives its takes one after the other. Models are kept in the folder."""
    found: dict[str, Callable[[], Iterator[Trial]]] = {}
    for name in whole_takes.CASES:
        found[f"points {name}"] = partial(whole, name, keep)
    for name in ("own", "others"):
        found[f"short {name}"] = partial(whole, name, keep, SHORT)
    found["points as recorded"] = partial(of_strangers_takes, None)
    found["strangers body26"] = partial(of_strangers_takes, whole_takes.Pieces())
    found["plates"] = partial(on_plates, keep)
    for kind in actors.MEETINGS:
        found[f"several {kind}"] = partial(together, kind, keep, 10)
    found["several auto"] = partial(together, "walkers-2", keep, 10, True)
    for kind in ("passing", "beside", "behind", "three", "returning"):
        found[f"blobs of several {kind}"] = partial(together_in_images, kind, keep, 8)
    found["blobs of several passing, one asked for"] = partial(together_in_images, "passing", keep, 8, True)
    for name in ("gait15", "body26"):
        found[f"blobs standing {name}"] = partial(in_images, standing, name, STANDING)
        for title, more in WALKED.items():
            found[f"blobs walking{title} {name}"] = partial(in_images, walking, name, None, keep, **more)
        for title, more in CURVES.items():
            found[f"curve {title} {name}"] = partial(in_images, standing, name, CURVE, **more)
    found["blobs strangers"] = partial(of_strangers, "body26", DRAWS)
    found["blobs strangers' takes, body26"] = lambda: in_a_ring(strangers_takes())
    found["blobs strangers' takes, body39"] = lambda: in_a_ring(takes_of_other_labs(keep))
    found["strangers' frames that numbers were chosen on"] = partial(of_strangers, "body26", DRAWS, True)
    found["blobs real"] = partial(recorded, keep)
    for kind in ("plugin_gait", "still", "plates", "animal_hand"):
        found[f"strangers {kind}"] = partial(of_other_labs, kind, keep)
    found["strangers in part"] = partial(of_parts, keep)
    return found
