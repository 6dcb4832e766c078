# SPDX-License-Identifier: GPL-3.0-or-later
"""Edits in words, for the list that a person reads."""

import re

from ..data.wording import words_of_frames
from .kinds import Edit

# Frames in a sentence: one, or the first and last of some. How many there are is said before the word.
FRAMES_SAID = re.compile(r"\bframes? -?\d+(?:(?:–| to )-?\d+)?")


def words_of(edit: Edit, shift: int = 0) -> str:
    """What an edit says, and of which frames, such as "LKNE is trajectory 12, frame 7"; `shift` is added to these."""
    target = edit.target
    said = edit.verb.words.format(target=target, Target=target[:1].upper() + target[1:], marker="".join(edit.names[:1]))
    if edit.span is None:
        return f"{said}, all frames"
    first, last = (number + shift for number in edit.span)
    return f"{said}, {words_of_frames(first, last)}"


def counted_on(words: str, shift: int) -> str:
    """A sentence with `shift` added to the frames that it names: for who counts them otherwise than the source."""

    def moved(found: re.Match) -> str:
        return re.sub(r"-?\d+", lambda number: str(int(number[0]) + shift), found[0])

    return FRAMES_SAID.sub(moved, words) if shift else words
