# SPDX-License-Identifier: GPL-3.0-or-later
"""When an operator can be used; where it cannot, its grey button tells what is to be done first."""

import bpy

from ..scene.performers import homes
from ..scene.playing import played_takes
from ..scene.take import is_take

PLAYED_WORDS = "This take plays from a file and has no keys: open a part of it, with Open Part under Long Take"


def lacks_take(context: bpy.types.Context) -> str:
    """What to do where no labelled take is active; else nothing."""
    if is_take(context.scene.mocap_autolabel.take):
        return ""
    return PLAYED_WORDS if played_takes(context.scene) else "Label a take first"


def lacks_one_performer(context: bpy.types.Context) -> str:
    """What to do with a take of several performers, where there has to be one; else nothing."""
    several = bool(homes(context.scene.mocap_autolabel.take))
    return "The take is of several performers: export one of them as C3D, and train on that" if several else ""


def lacks_object_mode(context: bpy.types.Context) -> str:
    """What to do outside object mode, where objects can be neither selected nor made; else nothing."""
    return "" if context.mode == "OBJECT" else "Go to object mode first"


class TellsWhyNot:
    """An operator that can be used where it lacks nothing; those that need more than another ask that one first."""

    @classmethod
    def lacks(cls, context: bpy.types.Context) -> str:
        """What is to be done first, in one sentence without its full stop; empty where nothing is lacking."""
        raise NotImplementedError

    @classmethod
    def poll(cls, context):
        words = cls.lacks(context)
        if words:
            cls.poll_message_set(words)
        return not words


class WithTake(TellsWhyNot):
    """Operators that need an active take, of blobs or points, and no mode."""

    @classmethod
    def lacks(cls, context):
        return lacks_take(context)


class OfTake(TellsWhyNot):
    """Operators on the active take, of blobs or points."""

    @classmethod
    def lacks(cls, context):
        return lacks_take(context) or lacks_object_mode(context)
