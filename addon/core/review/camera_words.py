# SPDX-License-Identifier: GPL-3.0-or-later
"""What the sentences of `odd_cameras` are about: told by their words, where only these are left, as in a report."""

from collections.abc import Sequence

OF_ROOM = "the room seems"  # how sentences about a room as a whole begin


def cameras_in(words: str, names: Sequence[str]) -> tuple[str, ...]:
    """The cameras, of these names, that a sentence of `CameraCheck` is about; none where it is about something else."""
    return tuple(name for name in names if _is_about(words, name))


def _is_about(words: str, name: str) -> bool:
    # By what stands around a name, as cameras may be called 1, 2 and 12, and the sentences hold figures.
    single = words.startswith((f"camera {name} seems ", f"camera {name} shows ", f"cameras {name} and "))
    return single or f" and {name} seem to have " in words or f" of {name} fit the calibration " in words
