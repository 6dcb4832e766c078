# SPDX-License-Identifier: GPL-3.0-or-later
"""`summary.report.html`: the takes of a folder beside each other, the worst first, each with a link to its own page."""

import os
from collections.abc import Sequence
from pathlib import Path
from urllib.parse import quote

from ...core.data.wording import count_of
from ..batch import FAILING, TakeRow, worst_first
from .drawings import bar
from .markup import GENERATOR, Html, element, length, name_of, percent, section, table, write_page


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
    heads = [
        "Take",
        "To look at",
        "At stake",
        "Named",
        "On the body",
        "Samples found",
        "Frames whole",
        "Frames",
        "Time",
    ]
    heads += ["Gaps filled"] if filled else []
    cells = [_cells(row) + ([_gaps(row)] if filled else []) for row in takes]
    words = (
        "Those with the most at stake first: frames of a marker that are wrong or missing if what is to be looked at "
        "is as it seems. On the body is what has no name there. A frame is whole where every marker of the take is "
        "found"
    )
    return section("Takes", table(heads, cells, words, {1, 2, 3, 4, 7, 8, 9} & set(range(len(heads)))))


def _cells(row: TakeRow) -> list:
    return [
        element("a", name_of(row.take), href=_link(row.page)) if row.page else name_of(row.take),
        f"{row.trouble:,}",
        f"{row.at_stake:,.0f}",
        percent(row.named),
        f"{row.on_body:,}",
        bar(row.found, f"Samples found of {row.take}"),
        bar(row.whole / max(row.frames, 1), f"Frames whole of {row.take}"),
        f"{row.frames:,}",
        f"{length(row.seconds)} s",
    ]


def _gaps(row: TakeRow) -> str:
    return "–" if row.gaps is None else f"{row.gaps[0]:,} of {row.gaps[1]:,}"


def _link(name: str) -> str:
    """A file beside the page as a link, whatever its name holds."""
    return "./" + quote(os.fsencode(name))


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
