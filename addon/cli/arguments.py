# SPDX-License-Identifier: GPL-3.0-or-later
"""The kinds of arguments that several verbs of the command line take."""

import argparse
import os
import re
from collections.abc import Callable
from glob import glob
from inspect import signature
from pathlib import Path
from typing import Any, TypeVar

from ..core.geometry.camera_up import AXIS_NAMES
from ..jobs.job import USUAL_RATE

Job = TypeVar("Job")


def frame_range(text: str) -> tuple[int | None, int | None]:
    """`A:B`, both included, either left out for the take's own end."""
    ends = re.fullmatch(r"\s*([+-]?\d{1,18})?\s*:\s*([+-]?\d{1,18})?\s*", text, re.ASCII)
    if ends is None:
        raise argparse.ArgumentTypeError(f"{text[:60]!r} is no range of frames; expected A:B, such as 100:250")
    first, last = (None if end is None else int(end) for end in ends.groups())
    if first is not None and last is not None and first > last:
        raise argparse.ArgumentTypeError(f"frames {text} end before they begin; expected A:B with A up to B")
    return first, last


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


def names(text: str) -> tuple[str, ...]:
    """Names with commas between them."""
    found = tuple(name.strip() for name in text.split(",") if name.strip())
    if not found:
        raise argparse.ArgumentTypeError(f"{text!r} names nothing; expected names such as LASI,RASI,SACR")
    return found


class Takes(argparse.Action):
    """Takes, and what `*` and `?` in their names stand for where the shell leaves that to programs, as on Windows."""

    def __call__(self, _parser, namespace, values, _flag=None):
        """Adds them to those before, each once; what stands for nothing stays as it is, to be told of."""
        found = list(getattr(namespace, self.dest) or [])
        for path in values:
            pattern, is_there = str(path).replace("[", "[[]"), os.path.lexists(path)  # [ is no wildcard there
            many = [] if is_there else sorted(glob(pattern))  # noqa: PTH207 - as shells do, without hidden files
            found += map(Path, many or [path])
        setattr(namespace, self.dest, list(dict.fromkeys(found)))


# What several verbs take, each under the same name and with the same words.
OPTIONS: dict[str, dict] = {
    "--overwrite": {"action": "store_true", "help": "replace output files that exist"},
    "--frames": {
        "type": frame_range,
        "metavar": "A:B",
        "help": "only these frames, both included, by the source's own numbers",
    },
    "--cameras": {"type": Path, "metavar": "CAMERAS", "required": True, "help": "the calibration of the room"},
    "--model": {
        "type": a_model,
        "metavar": "MODEL",
        "help": "a built-in model (see models) or a *.markerset.json file",
    },
    "--plain": {
        "action": "store_true",
        "help": "write points alone, in mm with z up; else the C3D of a C3D keeps all else of that: analog data, force "
        "plates, events, every other group, points that are no markers, its unit and axes; "
        "and of a TRC, a Motive .csv and a .tsv the head is kept",
    },
    "--up": {
        "choices": AXIS_NAMES,
        "help": "the axis that points up in the files that are read (default: what is said there, or else what is in "
        "there tells; --up -y and --up=-y are the same)",
    },
    "--rate": {
        "type": number(0.1, 100_000, "rate"),
        "metavar": "HZ",
        "help": f"frames a second, where the files say none (of blobs {USUAL_RATE:g} are assumed then)",
    },
}
# `--cameras` of blobs, which a capture may bring itself.
OWN_CAMERAS = {"required": False, "help": "the calibration; blobs need it, but for those of a .qtm, which has its own"}


def add_options(parser: argparse.ArgumentParser, *flags: str, **changed):
    """Adds some of OPTIONS; `changed` is said otherwise of all of these."""
    for flag in flags:
        parser.add_argument(flag, **OPTIONS[flag] | changed)


def job_of(kind: Callable[..., Job], arguments: argparse.Namespace, **more: Any) -> Job:
    """A job, whose fields are what the arguments of these names say, and `more`."""
    given = {name: getattr(arguments, name) for name in signature(kind).parameters if hasattr(arguments, name)}
    return kind(**given | more)
