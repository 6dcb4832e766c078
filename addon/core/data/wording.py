# SPDX-License-Identifier: GPL-3.0-or-later
"""How what many parts tell is put into words."""


def words_of_frames(first: int, last: int) -> str:
    """The frames from the first to the last, in a sentence."""
    return f"frame {first}" if first == last else f"frames {first}–{last}"
