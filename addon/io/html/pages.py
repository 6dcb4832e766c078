# SPDX-License-Identifier: GPL-3.0-or-later
"""`STEM.report.html` and `summary.report.html`: what a person should see of a take, or of a folder of takes."""

import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from urllib.parse import quote

from ...core.data.wording import count_of, words_of_frames
from ...core.edits.kinds import words_of
from ...core.review.overview import CELL_STATES, TakeOverview
from ...core.review.suspects import cameras_in
from ..batch import FAILING, TakeRow, worst_first
from ..provenance import MADE_OF
from .drawings import bar, moment_views, strip_legend, time_strips
from .markup import GENERATOR, Html, element, escaped, joined_html, length, name_of, percent, section, table, write_page

# How labels came about, in the order of label files.
STEP_WORDS = {
    "exclusive": "by the program: the only marker near that blob",
    "conflict": "by the program: the likeliest of several",
    "remaining": "by the program: what was left over",
    "evidence": "by the program: by likelihood",
    "ensemble": "by the program: by partial solvers",
    "fit": "by the program: by the fitted body",
    "trajectory": "by the program: by the rest of its trajectory",
    "edit": "by hand",
}


# How many rows a page lists before it says how many more there are; what a person reads.
LISTED_ROWS = 250  # of doubts, edits and notes
LISTED_GAPS = 40  # of gaps, the worst of which come first


def write_take_page(path: Path, report: Mapping, overview: TakeOverview, source: str, written: str):
    """Writes the page of a take: its report, and an overview of all of its frames.

    source is the name of its file, written the day on which this is, both as text.
    """
    title = f"{report['take']}: labelled take"
    parts = (
        _head(report, overview),
        _tiles(report, overview),
        _notes(report),
        _worst(overview),
        _to_look_at(report),
        _found(report),
        _by_time(overview),
        _cameras(report, overview),
        _by_whom(report, overview),
        _filled(report),
        _origins(report),
        _made(report, overview, source),
        element(
            "footer",
            f"Made by {GENERATOR} {report['version']} on {written}. This page asks for nothing from elsewhere.",
        ),
    )
    write_page(path, title, (part for part in parts if part is not None))


def _head(report: Mapping, overview: TakeOverview) -> Html:
    seconds = overview.frames / report["rate"]
    clock = f"{seconds:.1f} s" if seconds < 60 else f"{int(seconds // 60)} min {seconds % 60:.0f} s"
    words = f"{count_of(overview.frames, 'frame')} ({clock}), marker set "
    return joined_html(
        [
            element("h1", name_of(report["take"])),
            element("p", words, _model_of(report), f", labelled by {GENERATOR} {report['version']}", class_="soft"),
        ]
    )


def _model_of(report: Mapping) -> Html:
    """The marker set, and which version of it where that is known."""
    version = f", version {report['model_version']}" if "model_version" in report else ""
    return joined_html([name_of(report["model"]), escaped(version)])


def _tiles(report: Mapping, overview: TakeOverview) -> Html:
    totals = overview.cells.values.sum(axis=(0, 1))
    state = dict(zip(CELL_STATES, totals.tolist(), strict=True))
    things = "points" if "points" in report else "blobs"
    count = report[things]
    with_name = state["named"] + state["doubtful"] + state["edited"]
    cells = max(float(totals.sum()), 1.0)
    never = _never(report)
    markers = len(report["markers"])
    tiles = [
        (percent((count - report["unlabelled"]) / count if count else None), f"of {count:,} {things} named"),
        (percent(with_name / cells), f"of all samples found; {markers - len(never)} of {markers} markers"),
        (
            percent(report["frames_whole"] / max(report["frames"], 1)),
            "of frames whole" + (f", but for {count_of(len(never), 'marker')} never found" if never else ""),
        ),
        (
            percent(state["doubtful"] / max(with_name, 1)),
            f"of found samples doubtful; {sum(not one['answered'] for one in report['trouble'])} to look at",
        ),
    ]
    if state["filled"]:
        tiles.append((percent(state["filled"] / cells), "of all samples filled, not measured"))
    if overview.edits:
        tiles.append((f"{len(overview.edits):,}", "corrections by hand"))
    return element("ul", *(element("li", element("strong", figure), words) for figure, words in tiles), class_="tiles")


def _never(report: Mapping) -> list[str]:
    """The markers that are in space in no frame."""
    return [name for name, row in report["markers"].items() if not row["labelled_frames"]]


def _notes(report: Mapping) -> Html | None:
    notes = [*report.get("camera_doubts", ()), *report.get("calibration", ()), *report.get("notes", ())]
    if never := _never(report):
        notes.insert(0, f"never found: {', '.join(never)}")
    if report.get("frames_without_person"):
        notes.append(f"nobody was found in {count_of(report['frames_without_person'], 'frame')}")
    if report.get("rate_assumed"):
        notes.append(f"nobody gave the rate: {report['rate']:g} frames a second were assumed")
    if report.get("unit_assumed"):
        notes.append(f"the file names no unit that is known: {report['unit_assumed']} was assumed")
    if "c3d_first_frame" in report:
        notes.append(f"frames of the C3D file are numbered from {report['c3d_first_frame']}")
    notes += [f"{name} is {short} in the C3D file" for name, short in report.get("c3d_names", {}).items()]
    if not notes:
        return None
    lines = (element("li", _sentence(words)) for words in notes[:LISTED_ROWS])
    return element("div", element("ul", *lines), class_="notes", role="note", aria_label="Notes")


def _sentence(words: str) -> str:
    return words[:1].upper() + words[1:]


def _worst(overview: TakeOverview) -> Html | None:
    figures = []
    for moment in overview.keeper.worst():
        suspect = moment.suspect
        names = overview.subject.markers
        figures.append(
            element(
                "figure",
                element("h3", f"Frame {moment.frame}"),
                moment_views(moment, names, overview.subject.parents),
                element("figcaption", f"{_sentence(suspect.reason)}. {_frames(suspect.first, suspect.last)}."),
            )
        )
    if not figures:
        return None
    words = (
        "Doubtful markers are ringed and the markers beside them named; a dotted circle is where the body has the "
        "marker, a cross a point without a name. From the front the subject's left is on the right."
    )
    return section("Worst moments", element("p", words, class_="soft"), element("div", *figures, class_="moments"))


def _frames(first: int, last: int) -> str:
    return words_of_frames(first, last).capitalize()


def _to_look_at(report: Mapping) -> Html | None:
    found = [one for one in report["trouble"] if not one["answered"]]
    if not found:
        return section("To look at", element("p", "Nothing."))
    rows = [
        (_frames(one["first"], one["last"]), _sentence(one["reason"]), _sentence(one["advice"]))
        for one in found[:LISTED_ROWS]
    ]
    words = "The worst first: where most would be wrong or missing if it is as it looks"
    return section("To look at", table(("Where", "What", "What to do"), rows, words), _more(found, LISTED_ROWS))


def _more(rows: Sequence, most: int, where: str = "the report as JSON") -> Html | None:
    left = len(rows) - most
    return element("p", f"And {left:,} more, which {where} lists.", class_="soft") if left > 0 else None


def _found(report: Mapping) -> Html | None:
    frames = max(report["frames"], 1)
    residual = any(row["mean_residual_mm"] for row in report["markers"].values())
    heads = ["Marker", "Found", "Gaps", "Longest"] + (["Residual, mm"] if residual else [])
    rows: list[list] = []
    for name, row in sorted(report["markers"].items(), key=lambda item: item[1]["labelled_frames"]):
        share = row["labelled_frames"] / frames
        cells = [name_of(name), bar(share, f"Frames with {name}"), f"{row['gaps']:,}", f"{row['longest_gap']:,}"]
        rows.append(cells + ([length(row["mean_residual_mm"])] if residual else []))
    words = "Frames in which each marker was found, the least found first; gaps, and the longest in frames"
    return section("Found, marker by marker", table(heads, rows, words, range(2, len(heads))))


def _by_time(overview: TakeOverview) -> Html | None:
    if not overview.frames:
        return None
    totals = overview.cells.values.sum(axis=(0, 1))
    states = [state for state, n in zip(CELL_STATES, totals, strict=True) if n or state in ("named", "gap")]
    width = overview.cells.width
    if width == 1:
        words = "Every column is a frame."
    else:
        words = (
            f"Every column is {width} frames: its colour says what most of them are, "
            "the strip at its foot the most serious that some of them are."
        )
    rows = [
        element("tr", element("th", name_of(name), scope="row", title=name), element("td", strip))
        for name, strip in zip(overview.subject.markers, time_strips(overview), strict=True)
    ]
    first = overview.first or 0
    # The last column may reach beyond the take, so that of the axis does too.
    shown = overview.cells.used * width
    marks = [first + round(part * (shown - 1) / 4) for part in range(5)]
    axis = element("div", *(element("span", f"{min(mark, overview.last)}") for mark in marks), class_="axis")
    heads = element(
        "tr", element("th", "Marker", scope="col"), element("th", _frames(first, overview.last), scope="col")
    )
    whole = element(
        "table",
        element("caption", words),
        element("thead", heads),
        element("tbody", *rows),
        element("tfoot", element("tr", element("td"), element("td", axis))),
        class_="time",
    )
    wide = element("div", whole, class_="wide", tabindex="0", role="region", aria_label="Markers over time")
    return section("Over time", strip_legend(states), wide)


def _cameras(report: Mapping, overview: TakeOverview) -> Html | None:
    names, doubts = overview.cameras.names, report.get("camera_doubts", ())
    rows = []
    for name, seen in report.get("cameras", {}).items():
        share = seen["named_blobs"] / seen["blobs"] if seen["blobs"] else None
        flags = [element("div", _sentence(words)) for words in doubts if name in cameras_in(words, names)]
        rows.append(
            (
                name_of(name),
                f"{seen['blobs']:,}",
                bar(share, f"Named blobs of {name}"),
                percent(seen["named"] / seen["in_image"] if seen["in_image"] else None),
                length(seen["reprojection_px"]),
                joined_html(flags) or "–",
            )
        )
    heads = ("Camera", "Blobs", "Named", "Of its markers", "Median, px", "To look at")
    words = (
        "Blobs and how many of them have a name; how many of the markers in its image have a blob; how far named blobs "
        "are from where their marker is (reprojection error)"
    )
    return section("Cameras", table(heads, rows, words, (1, 3, 4))) if rows else None


def _by_whom(report: Mapping, overview: TakeOverview) -> Html | None:
    steps = {step: count for step, count in report.get("steps", {}).items() if count}
    whole = max(sum(steps.values()), 1)
    rows = [(STEP_WORDS.get(step, step), f"{count:,}", percent(count / whole)) for step, count in steps.items()]
    parts: list[Html | None] = (
        [table(("Names given", "How many", "Part"), rows, "How the names came about", (1, 2))] if rows else []
    )
    if overview.edits:
        outcomes = [*overview.outcomes, *[None] * (len(overview.edits) - len(overview.outcomes))]
        listed = [
            (f"{number}", words_of(edit), "–" if out is None else f"{out.labels:,}" if out.labels else out.reason)
            for number, (edit, out) in enumerate(zip(overview.edits, outcomes, strict=True), 1)
        ]
        words = "What a person said, in the order in which it is applied, and how many labels or frames that is about"
        parts.append(table(("Number", "Said", "About"), listed[:LISTED_ROWS], words))
        parts.append(_more(listed, LISTED_ROWS, "the file of the edits"))
    elif rows:
        parts.append(element("p", "Nothing was said by hand."))
    return section("Named by program and by hand", *parts)


def _filled(report: Mapping) -> Html | None:
    if "filled" not in report:
        return None
    done, left = report["filled"], report["left"]
    parts: list[Html | None] = [
        element(
            "p",
            f"{count_of(len(done), 'gap')} filled by the program, {len(left):,} left. Nothing of that was measured.",
        )
    ]
    if done:
        worst = sorted(done, key=lambda row: -(row["expected_mm"] or 0.0))
        rows = [
            (name_of(row["marker"]), _frames(row["first"], row["last"]), row["method"], length(row["expected_mm"]))
            for row in worst[:LISTED_GAPS]
        ]
        words = "Gaps that were filled, those with the largest error to expect first"
        parts += [
            table(("Marker", "Where", "Method", "Error to expect, mm"), rows, words, (3,)),
            _more(worst, LISTED_GAPS),
        ]
    if left:
        reasons = [
            (name_of(row["marker"]), _frames(row["first"], row["last"]), _sentence(f"it {row['reason']}"))
            for row in left[:LISTED_GAPS]
        ]
        parts += [table(("Marker", "Where", "Why"), reasons, "Gaps that were left"), _more(left, LISTED_GAPS)]
    return section("Filled gaps", *parts)


def _origins(report: Mapping) -> Html | None:
    markers = report.get("provenance", {}).get("markers", {})
    rows = []
    for name, row in markers.items():
        filled = ", ".join(f"{count:,} {method}" for method, count in row["filled"].items()) or "0"
        counts = [f"{row[kind]:,}" for kind in ("measured", "hand", "missing", "smoothed")]
        sure = [percent((row["confidence"] or {}).get(kind)) for kind in ("lowest", "mean", "sure")]
        rows.append([name_of(name), *counts, filled, *sure])
    words = (
        "Samples of each marker: measured and named by the program, named or placed by hand, filled by a method or in "
        "the input already, missing; and the confidence of the names that the program gave"
    )
    heads = ("Marker", "Measured", "By hand", "Missing", "Smoothed", "Filled", "Lowest", "Mean", "From 99.9 % on")
    return section("Where every sample is from", table(heads, rows, words, range(1, 9))) if rows else None


def _digests(report: Mapping) -> dict[str, str]:
    """What the files are known again by."""
    made = report.get("provenance", {})
    files = {
        f"{kind.capitalize()} {row['file'].rpartition('/')[2]}": row["sha256"]
        for kind in MADE_OF
        for row in made.get(kind, ())
    }
    files |= {f"Result {report['take']}{ending}": sha256 for ending, sha256 in made.get("results", {}).items()}
    return {f"{name}, SHA-256": sha256 for name, sha256 in files.items()}


def _made(report: Mapping, overview: TakeOverview, source: str) -> Html | None:
    facts = {
        "File": name_of(source) if source else None,
        "Frames": f"{overview.first} to {overview.last}" if overview.frames else None,
        "Rate": f"{report['rate']:g} a second" + (", assumed" if report.get("rate_assumed") else ""),
        "Marker set": _model_of(report),
        "Fingerprint of the marker set": report.get("model_fingerprint"),
        "Method": report.get("method"),
        "Labels asked to be right": percent(report["target"]) if "target" in report else None,
        "Hidden markers by": report.get("occlusion"),
        "Up in the file": report.get("up_axis"),
        "Trajectories": f"{report['trajectories']:,}" if "trajectories" in report else None,
        "Cameras": f"{len(overview.cameras)}" if len(overview.cameras) else None,
        "Edits from": name_of(report["edits"]["file"]) if report.get("edits", {}).get("file") else None,
        "Program": f"{GENERATOR} {report['version']}",
        **_digests(report),
    }
    entries = [
        joined_html([element("dt", name), element("dd", value)]) for name, value in facts.items() if value is not None
    ]
    return section("How it was made", element("dl", *entries))


def write_folder_page(path: Path, rows: Sequence[TakeRow], written: str):
    """Writes the page over takes by their rows of the summary, and says of those that failed why.

    The takes' own pages lie beside this one; written is the day, as text.
    """
    ordered = worst_first(rows)
    labelled = [row for row in ordered if row.measured]
    failed = [row for row in ordered if row.state == FAILING]
    words = f"{count_of(len(labelled), 'take')} labelled" + (f", {len(failed)} failed" if failed else "")
    to_come = len(ordered) - len(labelled) - len(failed)
    words += f", {to_come} to come" if to_come else ""
    version = f"{GENERATOR} {labelled[0].version}" if labelled else GENERATOR
    parts = (
        element("h1", "Labelled takes"),
        element("p", f"{words}, {sum(row.frames for row in labelled):,} frames.", class_="soft"),
        _failed(failed),
        _takes(labelled),
        _markers(labelled),
        element("footer", f"Made by {version} on {written}. This page asks for nothing from elsewhere."),
    )
    write_page(path, "Labelled takes", (part for part in parts if part is not None))


def _failed(failed: Sequence[TakeRow]) -> Html | None:
    if not failed:
        return None
    rows = [(name_of(row.source), row.reason) for row in failed]
    return section("Takes that failed", table(("Take", "Why"), rows, "They have no page"))


def _takes(takes: Sequence[TakeRow]) -> Html | None:
    if not takes:
        return None
    filled = any(row.gaps for row in takes)
    heads = ["Take", "To look at", "At stake", "Named", "On the body", "Samples found", "Frames whole", "Frames"]
    heads += ["Time", *(["Gaps filled"] if filled else [])]
    cells = [
        _cells(row) + ([("–" if row.gaps is None else f"{row.gaps[0]:,} of {row.gaps[1]:,}")] if filled else [])
        for row in takes
    ]
    words = (
        "Those with the most at stake first: frames of a marker that are wrong or missing if what is to be looked at "
        "is as it seems. On the body is what has no name there. A frame is whole where every marker of the take is "
        "found"
    )
    return section("Takes", table(heads, cells, words, {1, 2, 3, 4, 7, 8, 9} & set(range(len(heads)))))


def _cells(row: TakeRow) -> list:
    return [
        element("a", name_of(row.take), href=("./" + quote(os.fsencode(row.page)))) if row.page else name_of(row.take),
        f"{row.trouble:,}",
        f"{row.at_stake:,.0f}",
        percent(row.named),
        f"{row.on_body:,}",
        bar(row.found, f"Samples found of {row.take}"),
        bar(row.whole / max(row.frames, 1), f"Frames whole of {row.take}"),
        f"{row.frames:,}",
        f"{length(row.seconds)} s",
    ]


def _markers(takes: Sequence[TakeRow]) -> Html | None:
    """How often each marker was found in all takes, and in which the least."""
    names = dict.fromkeys(name for row in takes for name in row.markers or ())
    rows = []
    for name in names:
        own = [row for row in takes if name in (row.markers or ())]
        found = [(row.markers or {}).get(name, 0) / max(row.frames, 1) for row in own]
        frames = [row.frames for row in own]
        mean = sum(part * count for part, count in zip(found, frames, strict=True)) / max(sum(frames), 1)
        least = min(range(len(own)), key=found.__getitem__)
        rows.append((mean, name, found[least], own[least].take))
    listed = [
        (
            name_of(name),
            bar(mean, f"Frames with {name}"),
            percent(least) if least < 1 else "–",
            name_of(take) if least < 1 else "–",
        )
        for mean, name, least, take in sorted(rows, key=lambda row: (row[0], row[2]))
    ]
    heads = ("Marker", "Found", "Least", "In take")
    return section("Markers", table(heads, listed, "In all takes, the least found first", (2,))) if listed else None
