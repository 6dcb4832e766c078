# SPDX-License-Identifier: GPL-3.0-or-later
"""`provenance` of a report: what a take's results were made of, by SHA-256, and whether all of it is as it was then."""

import hashlib
import json
import os
from collections.abc import Iterable, Iterator
from pathlib import Path

from ..core.data.errors import InputError
from ..core.data.takes import MAX_FRAME
from .edits import edits_beside
from .markersets import builtin_markersets
from .model_history import path_from, seen_at
from .source import digest, is_still, open_binary, read_json
from .text import can_be_written, cell_of, in_cell

REPORT = ".report.json"  # the last of a take's files to appear: where it is the others are
INSTEAD = "--overwrite to make it anew, or another folder for --out"
# What results are made of beside version and options: of each kind the files, with their SHA-256.
MADE_OF = ("input", "cameras", "model", "edits")


def file_rows(files: Iterable[Path], report: Path) -> list[dict]:
    """Files with their digests, called as a report's folder sees them, built-in marker sets by their names.

    A path that no report can have is there as tables have it.

    Raises InputError where one cannot be read.
    """
    builtin = {file: name for name, file in builtin_markersets().items()}
    return [{"file": builtin.get(file) or _called(report, file), "sha256": digest(file)} for file in files]


def _called(report: Path, file: Path) -> str:
    path = path_from(report, file)
    return path if can_be_written(path) else cell_of(path)


def read_report(path: Path, wanted: str = f"the report of an earlier run, {INSTEAD}") -> dict:
    """A report that says what it was made of; InputError where it does not, with what was `wanted`."""
    open_binary(path).close()  # what cannot be read says why
    try:
        report = read_json(path, "a report")
        if "made_of" in report:  # so earlier versions called it
            report["provenance"] = report.pop("made_of")
        made = report["provenance"]
        whole = all(isinstance(made[part], dict) for part in ("options", "results"))
        # The results lie beside the report, whatever a report says.
        if whole and all(Path(ending).name == ending for ending in made["results"]):
            return report
    except (InputError, AttributeError, LookupError, TypeError):
        pass
    raise InputError(f"does not say what it was made of; expected {wanted}", path)


def sealed(report: dict) -> dict:
    """A report whose provenance has the digest of all else that it says, but for the time that was taken."""
    return report | {"provenance": report["provenance"] | {"report": _digest_of(report)}}


def _is_as_sealed(report: dict) -> bool:
    return report["provenance"].get("report") == _digest_of(report)


def _digest_of(report: dict) -> str:
    made = {name: value for name, value in report["provenance"].items() if name != "report"}
    try:
        text = json.dumps(report | {"provenance": made, "timing": None}, sort_keys=True)
    except RecursionError:  # nobody writes one so deep
        return ""
    return hashlib.sha256(text.encode("ascii")).hexdigest()


def earlier_run(path: Path, now: dict) -> tuple[dict | None, bool]:
    """The report of an earlier run of the same, None where there is none, and whether any of its files is gone.

    `path` is the report's, `now` what this run is made of. Raises InputError where something is there that the same job
    did not make.
    """
    if not os.path.exists(path):  # noqa: PTH110
        return None, True
    report = read_report(path)
    stem = path.name.removesuffix(REPORT)
    if report.get("take") != stem:
        raise InputError(f"is of the take {report.get('take')!r}; expected that of {stem!r}, {INSTEAD}", path)
    then, now = _flat(report["provenance"]), _flat(now)
    if "--models" in now:  # that was found among them
        now["model"] = then["model"]
    other = [name for name in now | then if now.get(name) != then.get(name)]
    if other:
        what = f"is of a run that differs in {', '.join(other)}"
        raise InputError(f"{what}; expected the same as then, {INSTEAD}", path)
    missing, changed = _results_now(path, report)
    if not _is_as_sealed(report):
        changed.append(path)
    if changed:
        raise InputError(f"was changed since it was made; expected it as it was, {INSTEAD}", changed[0])
    return report, bool(missing)


def _flat(made: dict) -> dict:
    """What results were made of, the options beside the files, wherever these were."""
    called = {"wearers": "subject"}
    options = {f"--{called.get(name, name)}": value for name, value in made["options"].items()}
    return {name: _digests(made.get(name, [])) for name in MADE_OF} | {"version": made.get("version")} | options


def _digests(rows: object) -> object:
    """Those of files; what is none, as in reports of earlier versions, as it is."""
    if isinstance(rows, list) and all(isinstance(row, dict) for row in rows):
        return [row.get("sha256") for row in rows]
    return rows


def _results_now(path: Path, report: dict) -> tuple[list[Path], list[Path]]:
    """The results of the report at `path` that are gone, and those that are not as they were made."""
    missing, changed = [], []
    for ending, was in report["provenance"]["results"].items():
        file = path.with_name(path.name.removesuffix(REPORT) + ending)
        if not os.path.exists(file):  # noqa: PTH110 no name is too long for it
            missing.append(file)
        elif not is_still(file, was):
            changed.append(file)
    return missing, changed


def own_output(path: Path, first_frame: int) -> dict | None:
    """The report beside a take that `label` wrote, where the take is as it was written; else None.

    A file that was changed since was corrected elsewhere, and its labels are what somebody says. Frames of samples are
    called as in the file, whose first is `first_frame`: a C3D cannot say every number. InputError where one is none.
    """
    beside = path.with_name(path.stem + REPORT)
    try:
        report = read_report(beside)
        made = report["provenance"]["results"].get(path.suffix)
        fitting = isinstance(report.get("doubtful"), dict) and is_still(path, made)
    except InputError:
        return None
    first = report.get("first_frame", first_frame)
    if not fitting or first == first_frame:
        return report if fitting else None
    try:
        if type(first) is int and abs(first) <= MAX_FRAME:
            return _moved(report, first_frame - first)
    except (AttributeError, LookupError, TypeError, ValueError):
        pass
    raise InputError("is damaged in its frames; expected the report as it was written", beside)


def _moved(report: dict, by: int) -> dict:
    """A report with what is doubtful, filled or by hand in other frames."""

    def moved(spans: Iterable) -> list[list[int]]:
        return [[first + by, last + by] for first, last in spans]

    markers = report["provenance"].get("markers", {}).items()
    hand = {name: row | {"hand_frames": moved(row.get("hand_frames", ()))} for name, row in markers}
    return report | {
        "doubtful": {name: moved(spans) for name, spans in report["doubtful"].items()},
        "filled": [row | {"first": row["first"] + by, "last": row["last"] + by} for row in report.get("filled", ())],
        "provenance": report["provenance"] | {"markers": hand},
    }


def reports_meant(path: Path) -> list[Path]:
    """The reports of a folder, or the one of the take that a result, or the stem of all of them, is of.

    Raises InputError where there is none.
    """
    if path.is_dir():
        if found := sorted(one for one in path.iterdir() if one.name.endswith(REPORT)):
            return found
        raise InputError("holds no report of a take; expected a folder that label or fill wrote to", path)
    name = path.name.removesuffix(REPORT)
    while name:
        report = path.with_name(name + REPORT)
        if os.path.exists(report):  # noqa: PTH110 no name is too long for it
            return [report]
        name = name.rpartition(".")[0]
    wanted = "a result of label or fill, the stem of them all or their folder"
    raise InputError(f"has no report beside it; expected {wanted}", path)


def is_labelled(made: dict) -> bool:
    """Whether results are of a labelling, which heeds edits, and not of a filling."""
    return ".labels.csv" in made["results"]


def open_provenance(path: Path) -> dict:
    """A report of this version's form, every part of whose provenance can be looked at; InputError for any other."""
    wanted = "the report of a take as this version of label or fill writes it"
    report = read_report(path, wanted)
    made = report["provenance"]
    rows = [row for kind in MADE_OF for row in (made.get(kind) if isinstance(made.get(kind), list) else [None])]
    recorded = [row.get(key) if isinstance(row, dict) else None for row in rows for key in ("file", "sha256")]
    recorded += [made.get("version"), made.get("report"), *made["results"].values()]
    if not all(isinstance(one, str) for one in recorded):
        raise InputError(f"does not say which files it was made of; expected {wanted}", path)
    return report


def differences(path: Path, report: dict, version: str, asked: Path) -> list[str]:
    """What is otherwise than when the results of the report at `path` were made, a few words each; none where nothing.

    `asked` is what somebody asked about, which may be no result of these.
    """
    made, stem = report["provenance"], path.name.removesuffix(REPORT)
    found = []
    if not asked.is_dir() and asked.name.removeprefix(stem) not in ("", REPORT, *made["results"]):
        found.append(f"{asked.name} is none of its results")
    if not _is_as_sealed(report):
        found.append("the report was changed")
    if made["version"] != version:
        found.append(f"it was made by version {made['version']} and this is {version}")
    missing, changed = _results_now(path, report)
    found += [f"{file.name} is gone" for file in missing] + [f"{file.name} was changed" for file in changed]
    return [*found, *_inputs_now(path, made)]


def _inputs_now(report: Path, made: dict) -> Iterator[str]:
    """Which of the files that results were made of are not as they were; what moved may lie beside the report."""
    builtin = builtin_markersets()
    rows = [(kind, row) for kind in MADE_OF for row in made[kind]]
    for kind, row in rows:
        called, own = row["file"], builtin.get(row["file"])
        seen = [own] if own else [seen_at(one, report) for one in (called, in_cell(called))]
        known = [one for one in seen if one is not None]
        if not known:
            yield f"nobody knows the file of its {kind}"
            continue
        places = [*known, *(report.parent / one.name for one in known)]
        there = [one for one in dict.fromkeys(places) if os.path.exists(one)]  # noqa: PTH110
        same = next((one for one in there if digest(one) == row["sha256"]), None)
        if same is None:
            yield f"the {kind} {called} {'was changed' if set(known) & set(there) else 'is gone'}"
        elif kind == "input" and is_labelled(made) and not made["edits"] and (edits := edits_beside(same)) is not None:
            yield f"{edits.name} is beside the input now"
