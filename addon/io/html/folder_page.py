# SPDX-License-Identifier: GPL-3.0-or-later
"""`summary.report.html`: the takes of a folder beside each other, the worst first, each with a link to its own page."""

import os
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from urllib.parse import quote

from .drawings import bar
from .markup import GENERATOR, Html, count_of, element, name_of, percent, section, table, write_page


def write_folder_page(
    path: Path, reports: Sequence[Mapping], failed: Iterable[tuple[str, str]], page: str, written: str
):
    """Writes the page over takes by their reports, and says of those that `failed`, by their names, why.

    `page` is what the name of a take's own page ends in, which lies beside this one; written is the day, as text.
    """
    failed = list(failed)
    ordered = sorted(reports, key=lambda report: (_found_part(report), -_open_trouble(report)))
    words = f"{count_of(len(reports), 'take')} labelled" + (f", {len(failed)} failed" if failed else "")
    version = f"{GENERATOR} {reports[0]['version']}" if reports else GENERATOR
    parts = (
        element("h1", "Labelled takes"),
        element("p", f"{words}, {sum(report['frames'] for report in reports):,} frames.", class_="soft"),
        _failed(failed),
        _takes(ordered, page),
        _markers(ordered),
        element("footer", f"Made by {version} on {written}. This page asks for nothing from elsewhere."),
    )
    write_page(path, "Labelled takes", (part for part in parts if part is not None))


def _found_part(report: Mapping) -> float:
    """The part of all samples, markers times frames, that was found."""
    found = sum(row["labelled_frames"] for row in report["markers"].values())
    return found / max(report["frames"] * len(report["markers"]), 1)


def _open_trouble(report: Mapping) -> int:
    """How much is to be looked at."""
    return sum(not one["answered"] for one in report["trouble"])


def _named_part(report: Mapping) -> float | None:
    count = report["points" if "points" in report else "blobs"]
    return (count - report["unlabelled"]) / count if count else None


def _failed(failed: Sequence[tuple[str, str]]) -> Html | None:
    if not failed:
        return None
    rows = [(name_of(take), reason) for take, reason in failed]
    return section("Takes that failed", table(("Take", "Why"), rows, "They have no page"))


def _takes(reports: Sequence[Mapping], page: str) -> Html | None:
    if not reports:
        return None
    filled = any("filled" in report for report in reports)
    heads = ["Take", "Frames", "Samples found", "Frames whole", "Named", "To look at"]
    heads += ["Gaps filled"] if filled else []
    rows = []
    for report in reports:
        whole, found, name = report["frames_whole"] / max(report["frames"], 1), _found_part(report), report["take"]
        cells = [element("a", name_of(name), href=_link(name + page)), f"{report['frames']:,}"]
        cells += [bar(found, f"Samples found of {name}"), bar(whole, f"Frames whole of {name}")]
        cells += [percent(_named_part(report)), f"{_open_trouble(report):,}"]
        if filled:
            cells.append(_gaps(report))
        rows.append(cells)
    words = (
        "Those with the smallest part of their samples found first; a frame is whole where every marker that the take "
        "has is found"
    )
    return section("Takes", table(heads, rows, words, {1, 4, 5, 6} & set(range(len(heads)))))


def _gaps(report: Mapping) -> str:
    if "filled" not in report:
        return "–"
    return f"{len(report['filled']):,} of {len(report['filled']) + len(report['left']):,}"


def _link(name: str) -> str:
    """A file beside the page as a link, whatever its name holds."""
    return "./" + quote(os.fsencode(name))


def _markers(reports: Sequence[Mapping]) -> Html | None:
    """How often each marker was found in all takes, and in which the least."""
    names = dict.fromkeys(name for report in reports for name in report["markers"])
    rows = []
    for name in names:
        own = [report for report in reports if name in report["markers"]]
        found = [report["markers"][name]["labelled_frames"] / max(report["frames"], 1) for report in own]
        frames = [report["frames"] for report in own]
        mean = sum(part * count for part, count in zip(found, frames, strict=True)) / max(sum(frames), 1)
        least = min(range(len(own)), key=found.__getitem__)
        rows.append((mean, name, found[least], own[least]["take"]))
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
