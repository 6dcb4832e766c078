# SPDX-License-Identifier: GPL-3.0-or-later
"""`models`: the built-in models and their markers."""

import textwrap

from ..io.markersets import builtin_markersets, open_markerset
from .console import print_results


def add_parser(verbs):
    """Adds the verb to the command line's grammar."""
    text = "Lists the built-in models and their markers."
    parser = verbs.add_parser("models", help="list the built-in models", description=text)
    parser.set_defaults(run=run)


def run(arguments) -> int:
    """Prints every built-in model."""
    sets = [open_markerset(name) for name in builtin_markersets()]
    lines = []
    for markerset in sets:
        lines.append(f"{markerset.name}: {markerset.description}")
        lines += textwrap.wrap(" ".join(markerset.markers), 100, initial_indent="  ", subsequent_indent="  ")
    models = [
        {
            "name": markerset.name,
            "description": markerset.description,
            "markers": list(markerset.markers),
            "aliases": dict(markerset.aliases),
            "segments": list(markerset.skeleton.segments),
            "source": markerset.source,
        }
        for markerset in sets
    ]
    print_results(lines, {"models": models}, arguments.json)
    return 0
