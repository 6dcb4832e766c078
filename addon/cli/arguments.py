# SPDX-License-Identifier: GPL-3.0-or-later
"""The kinds of arguments that several verbs of the command line take."""

import argparse
import re
from collections.abc import Callable
from pathlib import Path

from ..core.geometry.camera_up import AXIS_NAMES
from ..jobs.job import USUAL_RATE


def frame_range(text: str) -> tuple[int | None, int | None]:
    """`A:B`, both included, either left out for the take's own end."""
    ends = re.fullmatch(r"\s*([+-]?\d{1,18})?\s*:\s*([+-]?\d{1,18})?\s*", text, re.ASCII)
    if ends is None:
        raise argparse.ArgumentTypeError(f"{text[:60]!r} is no range of frames; expected A:B, such as 100:250")
    bounds = tuple(None if end is None else int(end) for end in ends.groups())
    if None not in bounds and bounds[0] > bounds[1]:
        raise argparse.ArgumentTypeError(f"frames {text} end before they begin; expected A:B with A up to B")
    return bounds


def a_model(text: str) -> str:
    """A model, which is not left out by being empty."""
    if not text:
        raise argparse.ArgumentTypeError("is empty; expected a model (a variable of the shell that is not set?)")
    return text


def number(low: float, high: float, what: str) -> Callable[[str], float]:
    """A reader of finite numbers from `low` to `high`, for `type=`."""
    return _bounded(float, low, high, what, f"a number from {low:g} to {high:g}")


def whole(low: int, high: int, what: str) -> Callable[[str], int]:
    """A reader of whole numbers from `low` to `high`, for `type=`."""
    return _bounded(int, low, high, what, f"a whole number from {low} to {high}")


def _bounded(kind: type, low: float, high: float, what: str, expected: str):
    def read(text: str):
        try:
            value = kind(text)
        except ValueError:
            value = float("nan")
        if not low <= value <= high:
            raise argparse.ArgumentTypeError(f"{text!r} is no {what}; expected {expected}")
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


def add_own_cameras(parser: argparse.ArgumentParser):
    """`--cameras CAMERAS` of blobs, which a capture may bring itself."""
    parser.add_argument(
        "--cameras",
        type=Path,
        metavar="CAMERAS",
        help="the calibration; blobs need it, but for those of a .qtm, which has its own",
    )


def add_up(parser: argparse.ArgumentParser, flag: str = "--up", where: str = "the files that are read"):
    """`--up AXIS`, for files that have another axis up than they say or seem to."""
    parser.add_argument(
        flag,
        choices=AXIS_NAMES,
        help=f"the axis that points up in {where} (default: what is said there, or else what is in there tells; "
        f"{flag} -y and {flag}=-y are the same)",
    )


def add_blob_rate(parser: argparse.ArgumentParser):
    """`--rate HZ`, for files of blobs, which say none."""
    parser.add_argument(
        "--rate",
        type=number(0.1, 100_000, "rate"),
        metavar="HZ",
        help=f"frames a second, which a blob file does not say (default {USUAL_RATE:g})",
    )


def add_point_rate(parser: argparse.ArgumentParser):
    """`--rate HZ`, for files of 3D points that say none."""
    parser.add_argument(
        "--rate",
        type=number(0.1, 100_000, "rate"),
        metavar="HZ",
        help="frames a second, used where a .c3d file says none",
    )
