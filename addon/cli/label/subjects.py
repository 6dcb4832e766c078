# SPDX-License-Identifier: GPL-3.0-or-later
"""Who is in the takes: `--model`, `--subjects` and `--subject` of the command line."""

import argparse
import re
from collections.abc import Sequence

from ... import jobs
from ...core.data.errors import InputError
from ...core.points.models import Model
from ...core.points.several.wearers import (
    AUTO,
    MAX_SUBJECTS,
    NAME_RULE,
    SetsWorn,
    SeveralOptions,
    Wearer,
    as_compared,
    is_subject_name,
)
from ...io.models import open_model


def add_subjects(parser: argparse.ArgumentParser):
    """`--subjects N|auto` and `--subject NAME=MODEL`."""
    parser.add_argument(
        "--subjects",
        type=_count,
        metavar="N|auto",
        help="how many wear the model, auto for as many as there are (default 1); markers are then "
        "called 1:LASI, 2:LASI",
    )
    parser.add_argument(
        "--subject",
        type=_wearer,
        action="append",
        metavar="NAME=MODEL",
        help="who wears what, once for each subject and instead of --model; markers are then called NAME:LASI",
    )


def _count(text: str) -> int:
    if text == "auto":
        return AUTO
    if not re.fullmatch(r"[1-9]", text, re.ASCII) or int(text) > MAX_SUBJECTS:
        words = f"{text[:60]!r} is no number of subjects"
        raise argparse.ArgumentTypeError(f"{words}; expected a whole number from 1 to {MAX_SUBJECTS}, or auto")
    return int(text)


def _wearer(text: str) -> tuple[str, str]:
    name, equals, model = text.partition("=")
    if not equals or not name or not model:
        words = f"{text[:60]!r} says not who wears what"
        raise argparse.ArgumentTypeError(f"{words}; expected NAME=MODEL, such as ann=body26")
    if not is_subject_name(name):
        raise argparse.ArgumentTypeError(f"{name[:60]!r} is no name of a subject; {NAME_RULE}")
    return name, model


def settle_subjects(arguments):
    """Settles what the arguments leave open; InputError where they contradict each other."""
    arguments.subject = list(arguments.subject or [])
    names = [as_compared(name) for name, _ in arguments.subject]
    if arguments.subject and (arguments.model or arguments.subjects is not None):
        other = "--model" if arguments.model else "--subjects"
        raise InputError(f"--subject and {other} both say who is there; expected one of them")
    if len(set(names)) < len(names):
        raise InputError("--subject names somebody twice; expected a name for each subject")
    if len(names) > MAX_SUBJECTS:
        raise InputError(f"--subject names {len(names)} subjects; expected up to {MAX_SUBJECTS}")
    if not arguments.model and not arguments.subject:
        raise InputError("nothing says what is worn; expected --model MODEL, or --subject NAME=MODEL for each subject")
    arguments.model = arguments.model or arguments.subject[0][1]
    arguments.subjects = 1 if arguments.subjects is None else arguments.subjects


def check_models(arguments) -> Model:
    """The model of whoever is first; InputError where one is not there, or is none for several subjects."""
    from ...core.points.naming import chosen_method, plain_method

    model = open_model(arguments.model)
    if arguments.subjects == 1 and not arguments.subject:
        return model
    for name in dict.fromkeys([arguments.model, *(worn for _, worn in arguments.subject)]):
        if plain_method(arguments.method) == "fit" or chosen_method(open_model(name), arguments.method) != "likelihood":
            words = f"several subjects need a model that names by likelihood, and {name} is not asked to"
            way = "--method auto, which names blobs by their points"
            raise InputError(f"{words}; expected {way}, and a model made by train")
    return model


def worn_in(take: jobs.LabelJob) -> SetsWorn:
    """The marker sets of all who may be in a take."""
    if not take.wearers:
        return SeveralOptions(open_model(take.model), take.subjects).possible
    return SetsWorn(tuple(Wearer(name, open_model(model)) for name, model in take.wearers))


def subject_words(model: str, subjects: int, wearers: Sequence[tuple[str, str]]) -> list[str]:
    """Who is asked for, said as in a job, as words of a command line."""
    if wearers:
        return [f"--subject={name}={worn}" for name, worn in wearers]
    words = [f"--model={model}"]
    if subjects != 1:
        words.append(f"--subjects={'auto' if subjects == AUTO else subjects}")
    return words
