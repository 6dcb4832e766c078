# SPDX-License-Identifier: GPL-3.0-or-later
"""The grammar of the command line: the verbs, and the kinds of arguments that several of them take."""

import argparse
import re
from typing import NoReturn

from ..core.errors import InputError
from ..version import version

DESCRIPTION = "Names the markers of optical motion capture takes."
SHARED_HELP = "exit status: 0 done, 1 the job could not be done, 2 bad arguments or bad input"


class Parser(argparse.ArgumentParser):
    """An argument parser that raises InputError instead of ending the process with a usage text."""

    def __init__(self, *args, **kwargs):
        kwargs.setdefault("allow_abbrev", False)
        kwargs.setdefault("epilog", SHARED_HELP)
        super().__init__(*args, **kwargs)
        # So that --frames -5:10 and --facing -1e1 are read as values, as -5 is.
        self._negative_number_matcher = re.compile(r"-\.?\d")

    def error(self, message: str) -> NoReturn:
        """What argparse calls when it cannot read the arguments."""
        wanted = f"expected arguments as {self.prog} --help tells"
        raise InputError(message if "; expected" in message else f"{message}; {wanted}")


def build_parser() -> Parser:
    """The parser of all verbs; each sets `run`, a function of the parsed arguments that gives the exit status."""
    from . import demo, evaluate, label, models, quality, reconstruct, simulate, train

    parser = Parser(prog="mocap-autolabel", description=DESCRIPTION)
    parser.add_argument("--version", action="version", version=f"mocap-autolabel {version()}")
    verbs = parser.add_subparsers(metavar="VERB", required=True)
    for verb in (label, train, reconstruct, evaluate, simulate, models, quality, demo):
        verb.add_parser(verbs)
    for each in verbs.choices.values():
        each.add_argument("--json", action="store_true", help="print the results as one JSON object")
        each.add_argument("--progress", action="store_true", help="tell the progress even where nobody watches")
        each.add_argument(
            "--traceback", action="store_true", help="with a fault of the program itself, show where it is"
        )
    return parser


def frame_range(text: str) -> tuple[int | None, int | None]:
    """`A:B`, both included, either left out for the take's own end."""
    ends = re.fullmatch(r"\s*([+-]?\d{1,18})?\s*:\s*([+-]?\d{1,18})?\s*", text, re.ASCII)
    if ends is None:
        raise argparse.ArgumentTypeError(f"{text[:60]!r} is no range of frames; expected A:B, such as 100:250")
    bounds = tuple(None if end is None else int(end) for end in ends.groups())
    if None not in bounds and bounds[0] > bounds[1]:
        raise argparse.ArgumentTypeError(f"frames {text} end before they begin; expected A:B with A up to B")
    return bounds


def number(low: float, high: float, what: str):
    """A reader of finite numbers from `low` to `high`, for `type=`."""

    def read(text: str) -> float:
        try:
            value = float(text)
        except ValueError:
            value = float("nan")
        if not low <= value <= high:
            raise argparse.ArgumentTypeError(f"{text!r} is no {what}; expected a number from {low:g} to {high:g}")
        return value

    return read


def whole(low: int, high: int, what: str):
    """A reader of whole numbers from `low` to `high`, for `type=`."""

    def read(text: str) -> int:
        try:
            value = int(text)
        except ValueError:
            value = low - 1
        if not low <= value <= high:
            raise argparse.ArgumentTypeError(f"{text!r} is no {what}; expected a whole number from {low} to {high}")
        return value

    return read


def names(text: str) -> list[str]:
    """A list of names with commas between them."""
    found = [name.strip() for name in text.split(",") if name.strip()]
    if not found:
        raise argparse.ArgumentTypeError(f"{text!r} names nothing; expected names such as LASI,RASI,SACR")
    return found


def add_overwrite(parser: argparse.ArgumentParser):
    """`--overwrite`, without which nothing that exists is replaced."""
    parser.add_argument("--overwrite", action="store_true", help="replace output files that exist")


def add_frames(parser: argparse.ArgumentParser):
    """`--frames A:B`."""
    parser.add_argument(
        "--frames",
        type=frame_range,
        metavar="A:B",
        help="only these frames, both included, by the source's own numbers",
    )
