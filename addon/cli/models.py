# SPDX-License-Identifier: GPL-3.0-or-later
"""`models`: the built-in models and their markers, or who taught models what; and a doubted one adopted."""

import textwrap
from pathlib import Path

from ..core.data.errors import InputError
from ..core.data.markersets import MarkerSet
from ..io.markersets import builtin_markersets, open_markerset
from .console import print_results

DESCRIPTION = """Lists the built-in models and their markers; of models that are named, their version, their fingerprint
and who taught them what. With --adopt, a model that was trained on and is waiting because known takes are named worse
by it takes its place, and the version that was there is kept beside it."""


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
        print_results([line for one in sets for line in _lines(one)], {"models": list(map(_row, sets))}, arguments.json)
        return 0
    # With all that models are named by, which nobody waits for who wants a list.
    from ..io.models import open_model
    from ..jobs.models import adopt
    from .model_history import history_lines, history_of

    names = arguments.models if arguments.adopt is None else [str(adopt(arguments.adopt))]
    opened = [(name, open_model(name)) for name in names]
    lines = [line for name, model in opened for line in history_lines(name, model)]
    rows = [_row(model.markerset) | {"file": name} | history_of(model) for name, model in opened]
    print_results(lines, {"models": rows}, arguments.json)
    return 0


def _lines(markerset: MarkerSet) -> list[str]:
    """A built-in model and its markers, for people."""
    markers = textwrap.wrap(" ".join(markerset.markers), 100, initial_indent="  ", subsequent_indent="  ")
    return [f"{markerset.name}: {markerset.description}", *markers]


def _row(markerset: MarkerSet) -> dict:
    return {
        "name": markerset.name,
        "description": markerset.description,
        "markers": list(markerset.markers),
        "aliases": dict(markerset.aliases),
        "segments": list(markerset.skeleton.segments),
        "source": markerset.source,
    }
