# SPDX-License-Identifier: GPL-3.0-or-later
"""Who is in a take: the name, marker set, markers, bones and colour of each; the only one of a take has no name."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import bpy
import numpy as np
from mathutils import Color

from ..core.data.markersets import Worn
from ..core.data.takes import Motion
from . import armature as armatures
from . import naming
from .ownership import made_collection, sign

COLOUR_OF = "mocap_colour"  # on the collection of a performer with a name: the material whose viewport colour is theirs
SEE_THROUGH = 0.35  # alpha of a performer's body
# sRGB, none near the red, blue and grey of what is doubtful, filled and unnamed; neighbours differ in brightness or for
# every kind of colour-blindness. With each the tag of its collection in the outliner.
PALETTE = (
    ((1.0, 0.75, 0.2), "COLOR_02"),
    ((0.66, 0.45, 1.0), "COLOR_06"),
    ((0.25, 0.85, 0.45), "COLOR_04"),
    ((1.0, 0.55, 0.8), "COLOR_07"),
    ((0.9, 0.95, 0.35), "COLOR_03"),
    ((0.25, 0.4, 1.0), "COLOR_05"),
    ((0.7, 0.5, 0.3), "COLOR_08"),
    ((0.1, 0.75, 0.7), "COLOR_04"),
)
Colour = tuple[float, float, float]  # sRGB


@dataclass(frozen=True)
class Performer:
    """One of a take's performers."""

    name: str  # by which their markers are called NAME:MARKER; empty for the only one of a take
    model: str  # the name of the marker set
    number: int  # how many are before
    markers: tuple[int, int]  # the first of their markers among all of the take, and how many there are
    joints: tuple[int, int]  # the same of the skeleton's joints

    @property
    def marker_rows(self) -> slice:
        """Their markers among all of the take."""
        return slice(self.markers[0], sum(self.markers))

    @property
    def joint_rows(self) -> slice:
        """Their joints among all of the take."""
        return slice(self.joints[0], sum(self.joints))

    def called(self, marker: str) -> str:
        """What the take calls one of their markers."""
        return f"{self.name}:{marker}" if self.name else marker

    def own_name(self, marker: str) -> str:
        """What their marker set calls a marker of the take."""
        return marker.removeprefix(f"{self.name}:") if self.name else marker

    def motion_of(self, motion: Motion) -> Motion:
        """Their part of the motion of all; frames in which they were not found have NaN as their size."""
        markers = ("markers", "residual", "residual_px", "conflicts", "expected")
        own = {name: getattr(motion, name)[:, self.marker_rows] for name in markers}
        own |= {name: getattr(motion, name)[:, self.joint_rows] for name in ("joints", "rotations")}
        return replace(motion, **own, scale=motion.scale[:, 3 * self.number : 3 * self.number + 3])


def performers_of(worn: Worn) -> tuple[Performer, ...]:
    """Who wears the sets of a take."""
    return performers_in_row((name, one.name, len(one), len(one.skeleton)) for name, one in worn.worn)


def performers_in_row(rows: Iterator[Sequence]) -> tuple[Performer, ...]:
    """The performers by name, marker set, number of markers and number of joints of each, as a file keeps them."""
    found, markers, joints = [], 0, 0
    for number, (name, model, own_markers, own_joints) in enumerate(rows):
        found.append(Performer(name, model, number, (markers, own_markers), (joints, own_joints)))
        markers, joints = markers + own_markers, joints + own_joints
    return tuple(found)


def rows_of(performers: Sequence[Performer]) -> list[list]:
    """What `performers_in_row` takes."""
    return [[one.name, one.model, one.markers[1], one.joints[1]] for one in performers]


def usual_colour(number: int) -> Colour:
    """The colour of a performer for whom none was chosen."""
    return PALETTE[number % len(PALETTE)][0]


def home_of(
    collection: bpy.types.Collection, performer: Performer, colours: Mapping[str, Colour]
) -> bpy.types.Collection:
    """The collection that a performer's armature, body and markers go into: of the only one of a take the take's."""
    if not performer.name:
        return collection
    colour = colours.get(performer.name, usual_colour(performer.number))
    home = homes(collection).get(performer.name)
    if home is None:
        home = made_collection(collection, collection, performer.name, performer.name)
        home[naming.PERFORMER] = performer.name
        home.color_tag = PALETTE[performer.number % len(PALETTE)][1]
    if body_material(home) is None:
        material = home[COLOUR_OF] = bpy.data.materials.new(naming.title(performer.name, "body"))
        material.diffuse_color[3] = SEE_THROUGH
        sign(material, "colour")
    set_colour(collection, performer.name, colour)
    return home


def homes(collection: bpy.types.Collection) -> dict[str, bpy.types.Collection]:
    """The collections of a take's performers by their names; none in a take of one."""
    return {str(child[naming.PERFORMER]): child for child in collection.children if naming.PERFORMER in child}


def body_material(home: bpy.types.Collection) -> bpy.types.Material | None:
    """The material of a performer's body, whose colour in the viewport is the performer's; None for who has no name."""
    return home.get(COLOUR_OF)


def colours_in(collection: bpy.types.Collection) -> dict[str, Colour]:
    """The colour of each performer of a take by name; none in a take of one."""
    materials = {name: body_material(home) for name, home in homes(collection).items()}
    return {
        name: usual_colour(number) if one is None else tuple(Color(one.diffuse_color[:3]).from_scene_linear_to_srgb())
        for number, (name, one) in enumerate(materials.items())
    }


def set_colour(collection: bpy.types.Collection, name: str, colour: Colour):
    """Gives a performer of a take another colour; nothing where the take has nobody of that name."""
    home = homes(collection).get(name)
    material = None if home is None else body_material(home)
    if material is not None:
        material.diffuse_color = (*Color(colour).from_srgb_to_scene_linear(), material.diffuse_color[3])


def marker_colours(
    collection: bpy.types.Collection | None, performers: Sequence[Performer], markers: int
) -> np.ndarray | None:
    """(M, 3) the colour of each marker of a take by its performer; None in a take of one."""
    colours = {} if collection is None else colours_in(collection)
    if not colours:
        return None
    found = np.ones((markers, 3))
    for one in performers:
        found[one.marker_rows] = colours.get(one.name, usual_colour(one.number))
    return found


def armatures_of(collection: bpy.types.Collection) -> list[tuple[str, bpy.types.Object]]:
    """The armatures that a take was shown with, each with its performer's name, empty in a take of one."""
    return [
        (name, item)
        for name, home in _places(collection).items()
        for item in home.objects
        if item.type == "ARMATURE" and armatures.SCALE in item
    ]


def without_armature(collection: bpy.types.Collection) -> list[str]:
    """The collections of a take whose armature was deleted: those of performers, or the take's own."""
    there = dict(armatures_of(collection))
    return [home.name for name, home in _places(collection).items() if name not in there]


def _places(collection: bpy.types.Collection) -> dict[str, bpy.types.Collection]:
    """Where each performer of a take is shown, by name: empty in a take of one, and then in the take itself."""
    return homes(collection) or {"": collection}
