# SPDX-License-Identifier: GPL-3.0-or-later
"""The grammar of the command line: its verbs, and what all of them take."""

import argparse
import re
from typing import NoReturn

from ..core.data.errors import InputError
from ..version import version

DESCRIPTION = "Names the markers of optical motion capture takes."
SHARED_HELP = "exit status: 0 done, 1 the job could not be done, 2 bad arguments or bad input"


class Parser(argparse.ArgumentParser):
    """An argument parser that raises InputError instead of ending the process with a usage text."""

    def __init__(self, *args, **kwargs):
        kwargs.setdefault("allow_abbrev", False)
        kwargs.setdefault("epilog", SHARED_HELP)
        super().__init__(*args, **kwargs)
        # So that --frames -5:10, --facing -1e1 and --up -z are read as values, as -5 is.
        self._negative_number_matcher = re.compile(r"-\.?\d|-[xyz]$")

    def error(self, message: str) -> NoReturn:
        """What argparse calls when it cannot read the arguments."""
        wanted = f"expected arguments as {self.prog} --help tells"
        raise InputError(message if "; expected" in message else f"{message}; {wanted}")


def build_parser() -> Parser:
    """The parser of all verbs; each sets `run`, a function of the parsed arguments that gives the exit status."""
    # Here and not above, so that Ctrl-C while NumPy loads ends in one line too.
    from . import demo, evaluate, fill, label, models, quality, reconstruct, refine, simulate, train

    parser = Parser(prog="mocap-autolabel", description=DESCRIPTION)
    parser.add_argument("--version", action="version", version=f"mocap-autolabel {version()}")
    verbs = parser.add_subparsers(metavar="VERB", required=True)
    for verb in (label, train, fill, refine, reconstruct, evaluate, simulate, models, quality, demo):
        verb.add_parser(verbs)
    for each in verbs.choices.values():
        each.add_argument("--json", action="store_true", help="print the results as one JSON object")
        each.add_argument("--progress", action="store_true", help="tell the progress even where nobody watches")
        each.add_argument(
            "--traceback", action="store_true", help="with a fault of the program itself, show where it is"
        )
    return parser
