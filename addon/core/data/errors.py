# SPDX-License-Identifier: GPL-3.0-or-later
"""The one family of exceptions that a user can do something about."""

import re
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

# Signs that move a terminal's cursor or end a line; a file may have them in any of its words.
UNSEEN = re.compile("[\x00-\x1f\x7f-\x9f\u2028\u2029]")
MAX_LETTERS = 1000  # of a message; what is quoted from a broken file may have a million


class UserError(Exception):
    """Trouble that the user can mend; its message is one sentence: what is wrong and what was expected.

    Operators turn it into one report, the command line into one line on standard error and `exit_status`.
    Whatever is not a `UserError` is a fault of ours and propagates.
    """

    exit_status = 2

    def __init__(self, message: str, file: str | Path = "", line: int = 0):
        message = re.sub(f"{UNSEEN.pattern}+", " ", message)
        if len(message) > MAX_LETTERS:  # what was expected comes last
            message = f"{message[: MAX_LETTERS // 2]} … {message[-MAX_LETTERS // 2 :]}"
        super().__init__(message)
        self.message = message
        self.file = str(file)
        self.line = line

    def __str__(self) -> str:
        place = spelt_out(self.file) + (f":{self.line}" if self.line else "")
        return f"{place}: {self.message}" if place else self.message


def spelt_out(text: str) -> str:
    r"""The text with each sign that moves a terminal's cursor or ends a line as an escape, such as `\u001b`."""
    return UNSEEN.sub(lambda sign: f"\\u{ord(sign[0]):04x}", text)


class InputError(UserError):
    """Input that cannot be used: missing, broken, of the wrong kind or in the wrong units (exit status 2)."""


class JobError(UserError):
    """The input was read but the job could not be done with it (exit status 1)."""

    exit_status = 1


class ForceableError(JobError):
    """What was read cannot be as it is, by what is in it: nothing is named of it, unless somebody knows better.

    Whoever knows better asks for `force`: `--force`, or the button beside the sentence.
    """


@contextmanager
def of_file(path: str | Path, kind: type[UserError] = UserError) -> Iterator[None]:
    """Names the file in trouble of a kind that the block has and that names none."""
    try:
        yield
    except kind as error:
        raise error if error.file else type(error)(error.message, path) from None
