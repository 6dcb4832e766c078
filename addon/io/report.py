# SPDX-License-Identifier: GPL-3.0-or-later
"""`STEM.report.json`: what a person should know of a labelled take before using it."""

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING

from ..core.data.takes import EditOutcome, Points, Suspect
from ..core.edits.applying import summary_of
from ..core.review.summary import TakeSummary
from ..core.review.take_trouble import TakeTrouble
from ..core.review.trouble import summary_of_trouble
from .c3d.writing import first_number, names_in_c3d

if TYPE_CHECKING:  # it is looked at, and none is made
    from ..core.review.odd_cameras import CameraCheck

# The stages that every report tells the seconds of; those that make the speed come from the labelling itself.
STAGES = ("load", "place", "fit", "label", "write")
WORK = ("place", "fit", "label")


def take_report(
    summary: TakeSummary, take: str, model: str, rate: float, version: str, seconds: Mapping[str, float]
) -> dict:
    """The contract's report of a take. `seconds` are those that the labelling does not know: `load` and `write`."""
    spent = {stage: summary.seconds.get(stage, 0.0) + seconds.get(stage, 0.0) for stage in STAGES}
    work = sum(spent[stage] for stage in WORK)
    return {
        "take": take,
        "model": model,
        "version": version,
        "rate": rate,
        "frames": summary.frames,
        "frames_without_person": summary.lost,
        "frames_whole": summary.whole,
        "blobs": summary.rows,
        "unlabelled": summary.unlabelled,
        "steps": summary.steps,
        "markers": summary.of_markers(),
        "suspect": [{"first": s.first, "last": s.last, "reason": s.reason} for s in summary.suspects],
        "timing": {
            **{stage: round(value, 4) for stage, value in spent.items()},
            **({"fill": round(seconds["fill"], 4)} if "fill" in seconds else {}),
            "frames_per_second": round(summary.frames / work, 2) if work > 0 else None,
        },
    }


def facts_of_edits(file: Path | None, outcomes: Iterable[EditOutcome]) -> dict:
    """What the report says of edits, where there are some, and of the file that they are from."""
    outcomes = tuple(outcomes)
    if not outcomes:
        return {}
    return {"edits": {"file": None if file is None else file.name, **summary_of(outcomes)}}


def facts_of_cameras(check: "CameraCheck", trouble: TakeTrouble, doubts: Iterable[Suspect]) -> dict:
    """What a report says of each camera and its blobs, and what is doubtful about the room."""
    counts = trouble.by_camera.figures()
    return {
        "cameras": {name: row | counts[name] for name, row in check.of_cameras().items()},
        "camera_doubts": [doubt.reason for doubt in doubts],
    }


def facts_of_trouble(trouble: TakeTrouble, suspects: Iterable[Suspect]) -> dict:
    """What a report says is the matter with a take, the worst first, and the same in half a sentence."""
    found = trouble.found(suspects)
    return {"trouble": [one.as_dict() for one in found], "to_look_at": summary_of_trouble(found)}


def renumbered(points: Points) -> dict:
    """What a report says where a C3D file cannot say what the take does: of frame numbers, and of long names."""
    facts: dict = {}
    first = first_number(points.first_frame, points.xyz.shape[0])
    if first != points.first_frame:
        facts["c3d_first_frame"] = first
    names = zip(points.names, names_in_c3d(points.names), strict=True)
    if other := {name: fitted for name, fitted in names if name != fitted}:
        facts["c3d_names"] = other
    return facts
