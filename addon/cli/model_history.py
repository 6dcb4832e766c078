# SPDX-License-Identifier: GPL-3.0-or-later
"""Who taught a model what, for people and as JSON."""

import textwrap

from ..core.evaluation.comparing import share
from ..core.points.history import ModelVersion, TaughtTake
from ..core.points.models import Model

SHOWN_DIGITS = 12  # of a fingerprint, which has 64: enough for people to know one by


def history_of(model: Model) -> dict:
    """A model's history for JSON."""
    history = model.history
    return {
        "version": history.version,
        "fingerprint": model.fingerprint,
        "history": [
            {**vars(one), "takes": [vars(take) for take in one.takes], "checked": [vars(row) for row in one.checked]}
            for one in history.versions
        ],
        "kept_takes": [vars(take) for take in history.kept_takes],
    }


def history_lines(name: str, model: Model) -> list[str]:
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


def _version_lines(one: ModelVersion) -> list[str]:
    words = [one.date, f"by {one.by}" if one.by else "", f"from {one.origin[:SHOWN_DIGITS]}" if one.origin else ""]
    lines = [f"  version {one.version:<5}{', '.join(filter(None, words))}"]
    if one.takes:
        lines += _wrapped("    taught     ", _subjects(one.takes))
    else:
        lines.append("    taught     nothing: it was given partial solvers")
    for row in one.checked:
        if row.recall[0] != row.recall[1] or row.wrong[0] != row.wrong[1]:
            (then, now), (wrong_then, wrong) = row.recall, row.wrong
            said = f"{share(now)} right ({share(then)} before), {share(wrong)} wrong ({share(wrong_then)} before)"
            lines.append(f"    {row.name}: {said}")
    if one.checked:
        told = "; some were named worse, and it was adopted all the same" if one.told else ""
        lines.append(f"    checked on {len(one.checked)} {'take' if len(one.checked) == 1 else 'takes'}{told}")
    return lines


def _subjects(takes: tuple[TaughtTake, ...]) -> list[str]:
    """The takes by whose they are."""
    found: dict[str, list[TaughtTake]] = {}
    for take in takes:
        found.setdefault(take.subject, []).append(take)
    return [
        f"{subject}: {', '.join(take.name for take in own)} ({sum(take.frames for take in own)} frames)"
        for subject, own in found.items()
    ]


def _wrapped(head: str, parts: list[str]) -> list[str]:
    return textwrap.wrap("; ".join(parts), 100, initial_indent=head, subsequent_indent=" " * len(head))
