# SPDX-License-Identifier: GPL-3.0-or-later
"""The grammar of the command line: its verbs, and what all of them take."""

import argparse
import re
from collections.abc import Sequence
from importlib import import_module
from pathlib import Path
from typing import NoReturn

from ..core.data.errors import InputError
from ..version import version

DESCRIPTION = "Names the markers of optical motion capture takes."
VERBS = (
    "label",
    "train",
    "fill",
    "refine",
    "reconstruct",
    "blobs",
    "evaluate",
    "verify",
    "simulate",
    "live",
    "models",
    "quality",
    "demo",
)
SHARED_HELP = "exit status: 0 done, 1 the job could not be done, 2 bad arguments or bad input"


class Parser(argparse.ArgumentParser):
    """An argument parser that raises InputError instead of ending the process with a usage text."""

    def __init__(self, *args, **kwargs):
        kwargs.setdefault("allow_abbrev", False)
        kwargs.setdefault("epilog", SHARED_HELP)
        super().__init__(*args, **kwargs)
        self.register("type", Path, a_path)
        # So that --frames -5:10, --facing -1e1 and --up -z are read as values, as -5 is.
        self._negative_number_matcher = re.compile(r"-\.?\d|-[xyz]$")

    def error(self, message: str) -> NoReturn:
        """What argparse calls when it cannot read the arguments."""
        wanted = f"expected arguments as {self.prog} --help tells"
        raise InputError(message if "; expected" in message else f"{message}; {wanted}")


def a_path(text: str) -> Path:
    """A path; one that is empty, as of a shell's variable that is not set, is not the folder that one is in."""
    if not text:
        raise argparse.ArgumentTypeError("is empty; expected a path (a variable of the shell that is not set?)")
    return Path(text)


def build_parser(argv: Sequence[str] = ()) -> Parser:
    """The parser of the verb that begins these arguments, or of all where none does.

    Each sets `run`, a function of the parsed arguments that gives the exit status.
    """
    parser = Parser(prog="mocap-autolabel", description=DESCRIPTION)
    parser.add_argument("--version", action="version", version=f"mocap-autolabel {version()}")
    verbs = parser.add_subparsers(metavar="VERB", required=True)
    for verb in argv[:1] if argv and argv[0] in VERBS else VERBS:
        # Here and not above: no verb waits for what others need, and Ctrl-C while NumPy loads ends in one line too.
        import_module(f".{verb}", __package__).add_parser(verbs)
    for each in verbs.choices.values():
        each.add_argument("--json", action="store_true", help="print the results as one JSON object")
        each.add_argument("--progress", action="store_true", help="tell the progress even where nobody watches")
        each.add_argument(
            "--traceback", action="store_true", help="with a fault of the program itself, show where it is"
        )
    return parser
