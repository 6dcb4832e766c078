# SPDX-License-Identifier: GPL-3.0-or-later
"""What is said of a take that was labelled, in lines for people."""


def as_line(report: dict) -> str:
    """One take's result as a line for people."""
    things = "points" if "points" in report else "blobs"
    count, named = report[things], report[things] - report["unlabelled"]
    speed = report["timing"]["frames_per_second"]
    pace = "" if speed is None else f", {speed:.0f} frames/s"
    if "edits" in report:
        applied = sum(report["edits"]["applied"].values())
        pace += f", {applied} edit{'' if applied == 1 else 's'} applied"
    unit = f", no unit in the file, taken for {report['unit_assumed']}" if "unit_assumed" in report else ""
    if "filled" in report:
        pace += f", {len(report['filled'])} of {len(report['filled']) + len(report['left'])} gaps filled"
    first = ", frames in the .c3d from 0" if "c3d_first_frame" in report else ""
    frames = f"{report['frames']} frame" + ("" if report["frames"] == 1 else "s")
    more = "".join(f"; {words}" for words in _remarks(report))
    if report.get("changed_in_all"):
        pace += f", {report['changed_in_all']} than before"
    look = f"; {report['to_look_at']}" if report.get("to_look_at") else ""
    return f"{report['take']}: {frames}, {named} of {count} {things} named{pace}{unit}{first}{more}{look}"


def doubts_in(report: dict) -> list[str]:
    """What is odd about the cameras of a take, and which edits found nothing, a line each."""
    missed = [
        f"edit {one['edit']} ({one['kind']}) found nothing: {one['reason']}"
        for one in report.get("edits", {}).get("found_nothing", [])
    ]
    return [f"{report['take']}: {words}" for words in (*report.get("camera_doubts", []), *missed)]


def _remarks(report: dict) -> list[str]:
    """What was decided about a take's files, in sentences."""
    said = [words for part in ("capture", "calibration", "notes") for words in report.get(part, [])]
    return [f"{words} (--use chooses)" if " are taken, not " in words else words for words in said]
