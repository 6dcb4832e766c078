# SPDX-License-Identifier: GPL-3.0-or-later
"""`STEM.report.json`: what a person should know of a labelled take before using it."""

import json
from collections.abc import Mapping
from pathlib import Path

from ..core.review.summary import TakeSummary

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


def write_report(path: Path, report: dict):
    """Writes a report as JSON, a marker a line, and a trouble."""
    markers = ",\n".join(f"    {compact(name)}: {compact(row)}" for name, row in report["markers"].items())
    parts = {key: compact(value) for key, value in report.items()}
    parts["markers"] = f"{{\n{markers}\n  }}"
    if report.get("trouble"):
        rows = ",\n".join(f"    {compact(row)}" for row in report["trouble"])
        parts["trouble"] = f"[\n{rows}\n  ]"
    text = ",\n".join(f"  {compact(key)}: {value}" for key, value in parts.items())
    Path(path).write_text(f"{{\n{text}\n}}\n", encoding="utf-8", newline="\n")


def compact(value: object) -> str:
    """A value as JSON of one line."""
    text = json.dumps(value, ensure_ascii=False, allow_nan=False)
    # A file's name may hold bytes that are no letters; JSON has an escape for each.
    return text.encode("utf-8", "backslashreplace").decode("utf-8")
