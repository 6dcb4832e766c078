# SPDX-License-Identifier: GPL-3.0-or-later
"""What all operators share: what they are called, when they can be used, and how trouble is reported."""

from collections.abc import Callable, Iterator
from functools import wraps
from typing import Any

import bpy
from bpy.props import StringProperty
from bpy_extras.io_utils import ExportHelper

from ..core.data.errors import UserError
from ..scene.opened import opened
from ..scene.performers import homes
from ..scene.playing import played_takes
from ..scene.stored import Stored
from ..scene.take import SOURCE, is_linked, is_take, takes_of

Need = Callable[[bpy.types.Context], str]
PLAYED_WORDS = "This take plays from a file and has no keys: open a part of it, with Open Part under Review"


def reports_trouble(method: Callable[..., set[str]]) -> Callable[..., set[str]]:
    """Wraps an operator's method, such as `invoke`, which need not say where it finished.

    A `UserError` ends it with one readable sentence. Whatever else goes wrong is the program's fault, and propagates.
    """

    def tried(self, *given) -> set[str]:
        try:
            return method(self, *given) or {"FINISHED"}
        except UserError as error:
            self.report({"ERROR"}, str(error))
            return {"CANCELLED"}

    def with_event(self, context, event):
        return tried(self, context, event)

    def without(self, context):
        return tried(self, context)

    # Blender counts the parameters of what it calls.
    return wraps(method)(with_event if method.__code__.co_argcount > 2 else without)


def reason_of(error: RuntimeError) -> str:
    """Why an operator that was called could not be used, without the word that Blender puts before."""
    return str(error).removeprefix("Error: ").strip()


def unless(holds: Callable[[bpy.types.Context], object], words: str) -> Need:
    """A need: these words where something does not hold."""
    return lambda context: "" if holds(context) else words


def lacks_take(context: bpy.types.Context) -> str:
    """What to do where no labelled take is active; else nothing."""
    if is_take(context.scene.mocap_autolabel.take):
        return ""
    return PLAYED_WORDS if played_takes(context.scene) else "Label a take first"


def lacks_own_take(context: bpy.types.Context) -> str:
    """What to do with a take that is another file's, where it cannot be changed; else nothing."""
    take = context.scene.mocap_autolabel.take
    if not (is_take(take) and is_linked(take)):
        return ""
    return "This take is linked from another file: change it there, or label it again here"


def lacks_object_mode(context: bpy.types.Context) -> str:
    """What to do outside object mode, where objects can be neither selected nor made; else nothing."""
    return "" if context.mode == "OBJECT" else "Go to object mode first"


class Ours:
    """An operator: called as its class is, and one step of undo. Where it cannot be used its grey button tells why.

    Its button has the words of its name, unless it has others. It differs in `work`, which ends with nothing where it
    is done, UserError where it cannot be; and in what it `needs`: each says what is to be done first, in one sentence
    without its full stop, and nothing where nothing is lacking.
    """

    bl_options = {"REGISTER", "UNDO"}
    needs: tuple[Need, ...] = ()
    differs_in = "work"

    def __init_subclass__(cls, **words):
        super().__init_subclass__(**words)
        module, found, name = cls.__name__.partition("_OT_")
        if found:
            cls.bl_idname = f"{module.lower()}.{name}"
            cls.bl_label = vars(cls).get("bl_label", name.replace("_", " ").title())

    @classmethod
    def lacks(cls, context: bpy.types.Context) -> str:
        """What is to be done first; empty where nothing is lacking."""
        return next((words for need in cls.needs if (words := need(context))), "")

    @classmethod
    def poll(cls, context):
        words = cls.lacks(context)
        if words:
            cls.poll_message_set(words)
        return not words

    @reports_trouble
    def execute(self, context):
        return self.work(context)


def operator(
    *needs: Need, of: type[Ours] = Ours, label: str = "", options: set[str] | None = None, **properties: Any
) -> Callable[[Callable[..., object]], type[Ours]]:
    """Makes an operator, called `MOCAP_AUTOLABEL_OT_` as well, of what alone it does otherwise than others of a kind.

    It needs more than they do and has more properties, and label and options where they are not those of its name and
    kind.
    """

    def made(work) -> type[Ours]:
        words = {"__module__": work.__module__, "__doc__": work.__doc__, of.differs_in: work}
        words |= {"needs": (*of.needs, *needs), "__annotations__": properties} | ({"bl_label": label} if label else {})
        words |= {} if options is None else {"bl_options": options}
        return type(f"MOCAP_AUTOLABEL_OT_{work.__name__}", (of, bpy.types.Operator), words)

    return made


class WithTake(Ours):
    """Operators that need an active take, of blobs or points, and no mode."""

    needs = (lacks_take,)


class PicksOfTake(Ours):
    """Operators that pick of the active take, of blobs or points, and change nothing of it."""

    needs = (lacks_take, lacks_object_mode)


class OfTake(Ours):
    """Operators that change the active take, of blobs or points."""

    needs = (lacks_take, lacks_own_take, lacks_object_mode)


class ToldWhere(ExportHelper):
    """Operators that ask for the file to write, which is the one that `proposed` gives where nobody chose one."""

    bl_options = {"REGISTER"}

    def __init_subclass__(cls, **words):
        super().__init_subclass__(**words)
        if "filename_ext" in vars(cls):
            only = StringProperty(default=f"*{cls.filename_ext}", options={"HIDDEN"})
            cls.__annotations__ = cls.__annotations__ | {"filter_glob": only}

    def invoke(self, context, event):
        if not self.filepath:
            self.filepath = str(self.proposed(context))
        return ExportHelper.invoke(self, context, event)


def taken(context: bpy.types.Context) -> Stored:
    """The active take as it is, with its edits, fills and smoothing."""
    return opened.take(context.scene.mocap_autolabel.take, context.scene)


def takes_of_file(scene: bpy.types.Scene, source: str) -> Iterator[bpy.types.Collection]:
    """The takes of a file in a scene, the active one first, then the latest; none where no file is known."""
    for take in (scene.mocap_autolabel.take, *reversed(takes_of(scene))):
        if source and is_take(take) and take[SOURCE] == source:
            yield take


def lacks_one_performer(context: bpy.types.Context) -> str:
    """What to do with a take of several performers, where there has to be one; else nothing."""
    several = bool(homes(context.scene.mocap_autolabel.take))
    return "The take is of several performers: export one of them as C3D, and train on that" if several else ""


def once(kind: Callable[..., Any], name: str, description: str, **more: Any) -> Any:
    """A property that an operator is told each time: it does not keep the value of the last."""
    return kind(name=name, description=description, options={"SKIP_SAVE"}, **more)


def remove_chosen(group: bpy.types.PropertyGroup, name: str):
    """Takes the chosen row out of a list such as `takes`, whose `take_index` goes to another."""
    rows, index = getattr(group, name), f"{name.removesuffix('s')}_index"
    last = len(rows) - 1
    rows.remove(min(getattr(group, index), last))
    setattr(group, index, max(min(getattr(group, index), last - 1), 0))
