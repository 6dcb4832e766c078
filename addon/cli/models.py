# SPDX-License-Identifier: GPL-3.0-or-later
"""`models`: the built-in models and their markers, or who taught models what; and a doubted one adopted."""

import textwrap
from collections.abc import Iterable
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING

from ..core.data.errors import InputError
from ..core.data.markersets import MarkerSet
from ..core.data.wording import count_of
from ..io.layouts import open_layout, shipped_layouts
from ..io.markersets import builtin_markersets, open_markerset
from .console import print_results

if TYPE_CHECKING:  # whoever wants a list waits for none of it
    from ..core.points.models import Model, ModelVersion, TaughtTake

SHOWN_DIGITS = 12  # of a fingerprint, which has 64: enough for people to know one by


def history_of(model: "Model") -> dict:
    """A model's history for JSON."""
    known = asdict(model.history)
    return {
        "version": model.history.version,
        "fingerprint": model.fingerprint,
        "history": known["versions"],
        "kept_takes": known["kept_takes"],
    }


def history_lines(name: str, model: "Model") -> list[str]:
    """A model's history for people, the newest version first."""
    history, count = model.history, len(model.markerset)
    lines = [
        f"{name}: {model.markerset.name}, version {history.version}, {count} markers",
        f"  fingerprint  {model.fingerprint}",
    ]
    lines += [line for one in reversed(history.versions) for line in _version_lines(one)]
    if not history.versions:
        lines.append("  nobody kept who taught it what")
    if history.kept_takes:
        lines += _wrapped("  checked on   ", [f"{take.name} of {take.subject}" for take in history.kept_takes])
    return lines


def _version_lines(one: "ModelVersion") -> list[str]:
    from ..core.evaluation.comparing import share

    words = [one.date, f"by {one.by}" if one.by else "", f"from {one.origin[:SHOWN_DIGITS]}" if one.origin else ""]
    lines = [f"  version {one.version:<5}{', '.join(filter(None, words))}"]
    if one.takes:
        lines += _wrapped("    taught     ", _subjects(one.takes))
    else:
        lines.append("    taught     nothing: it was given partial solvers")
    for row in one.checked:
        if row.recall[0] != row.recall[1] or row.wrong[0] != row.wrong[1]:
            (then, now), (wrong_then, wrong) = row.recall, row.wrong
            figures = f"{share(now)} right ({share(then)} before), {share(wrong)} wrong ({share(wrong_then)} before)"
            lines.append(f"    {row.name}: {figures}")
    if one.checked:
        note = "; some were named worse, and it was adopted all the same" if one.told else ""
        lines.append(f"    checked on {count_of(len(one.checked), 'take')}{note}")
    return lines


def _subjects(takes: "tuple[TaughtTake, ...]") -> list[str]:
    """The takes by whose they are."""
    found: dict[str, list[TaughtTake]] = {}
    for take in takes:
        found.setdefault(take.subject, []).append(take)
    return [
        f"{subject}: {', '.join(take.name for take in own)} ({count_of(sum(take.frames for take in own), 'frame')})"
        for subject, own in found.items()
    ]


def _wrapped(head: str, parts: list[str]) -> list[str]:
    return textwrap.wrap("; ".join(parts), 100, initial_indent=head, subsequent_indent=" " * len(head))


DESCRIPTION = """Lists the built-in models, the published marker sets in words, and their markers; of models that are
named, their version, their fingerprint and who taught them what. With --adopt, a model that was trained on and is
waiting because known takes are named worse by it takes its place, and the version that was there is kept beside it."""


def add_parser(verbs):
    """Adds the verb to the command line's grammar."""
    parser = verbs.add_parser("models", help="list models, and who taught them what", description=DESCRIPTION)
    parser.add_argument("models", metavar="MODEL", nargs="*", help="models to tell of (default: all built-in ones)")
    parser.add_argument(
        "--adopt", type=Path, metavar="CANDIDATE", help="put a model that train kept as a candidate into its place"
    )
    parser.set_defaults(run=run)


def run(arguments) -> int:
    """Prints the models, once a candidate has been adopted."""
    if arguments.adopt is not None and arguments.models:
        raise InputError("--adopt is of one model; expected no other models with it")
    if arguments.adopt is None and not arguments.models:
        sets = [open_markerset(name) for name in builtin_markersets()]
        layouts = {name: open_layout(name) for name in shipped_layouts()}
        lines = [line for one in sets for line in _set_lines(one.name, one.description, one.markers)]
        lines += ["", "In words, for train --set NAME --out MODEL:"]
        lines += [line for name, one in layouts.items() for line in _set_lines(name, one.description, one.sites)]
        rows = [
            {"name": name, "description": one.description, "markers": list(one.sites), "source": one.source}
            for name, one in layouts.items()
        ]
        print_results(lines, {"models": list(map(_row, sets)), "layouts": rows}, arguments.json)
        return 0
    # With all that models are named by, which nobody waits for who wants a list.
    from ..io.models import open_model
    from ..jobs.models import adopt

    names = arguments.models if arguments.adopt is None else [str(adopt(arguments.adopt))]
    opened = [(name, open_model(name)) for name in names]
    lines = [line for name, model in opened for line in history_lines(name, model)]
    rows = [_row(model.markerset) | {"file": name} | history_of(model) for name, model in opened]
    print_results(lines, {"models": rows}, arguments.json)
    return 0


def _set_lines(name: str, description: str, markers: Iterable[str]) -> list[str]:
    """A marker set and its markers, for people."""
    rows = textwrap.wrap(" ".join(markers), 100, initial_indent="  ", subsequent_indent="  ")
    return [f"{name}: {description}", *rows]


def _row(markerset: MarkerSet) -> dict:
    return {
        "name": markerset.name,
        "description": markerset.description,
        "markers": list(markerset.markers),
        "aliases": dict(markerset.aliases),
        "segments": list(markerset.skeleton.segments),
        "source": markerset.source,
    }
