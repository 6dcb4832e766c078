# SPDX-License-Identifier: GPL-3.0-or-later
"""Gaps filled and markers smoothed in the scene, and both taken back: kept beside labels and edits."""

from collections.abc import Callable, Sequence
from functools import partial

import bpy
import numpy as np
from bpy.props import BoolProperty, EnumProperty, IntProperty, StringProperty

from ..core.data.errors import InputError, UserError
from ..core.data.takes import Blobs
from ..core.data.wording import count_of
from ..core.filling.filling import FilledTake, FillOptions, SubjectMarkers, fill_subjects, kept_fills_of
from ..core.filling.kept import KeptFill, replaced_fills
from ..core.filling.rays import NO_RAYS, MarkerRays, rays_of
from ..core.filling.smoothing import smoothed
from ..core.posing.posing import POSING
from ..io.filled import left_rows
from ..io.text import written
from ..props import chosen_markerset, list_rows, refresh_review, row_of
from ..scene.clock import refresh_frame
from ..scene.fills import fills_text, keep_cutoff, keep_fills, kept_cutoff, kept_fills
from ..scene.later import redraw
from ..scene.opened import opened
from ..scene.performers import Performer
from ..scene.stored import Stored
from ..scene.take import is_take, show_edits
from .base import OfTake, once, operator, taken, takes_of_file, unless
from .correcting import selected_markers
from .listing import refuse_other_lists
from .long_work import LongWork, known_by
from .reposing import follow_soon

EXTENTS = (
    ("GAP", "Gap", "The gaps at the current frame: of the selected markers, of all where none is selected"),
    ("MARKER", "Marker", "All gaps of the selected markers"),
    ("TAKE", "Take", "All gaps of the take"),
)


def extent_property(words: str):
    """The property that says of what an operator is."""
    return EnumProperty(name="Extent", description=words, items=EXTENTS, default="TAKE")


def keep_and_show(context: bpy.types.Context, keep: Callable[[bpy.types.Collection], None]):
    """Lets `keep` change what the collection of the active take has beside its labels, and shows what follows."""
    scene, collection = context.scene, context.scene.mocap_autolabel.take
    before = opened.take(collection, scene)
    keep(collection)
    show_edits(collection, before, opened.take(collection, scene))
    refresh_frame(scene)
    refresh_review(context.window_manager, scene)


def kept_before(scene: bpy.types.Scene, source: str) -> dict:
    """The fills and the smoothing of the take of the same file when it was labelled before, as fields of a `Take`."""
    for take in takes_of_file(scene, written(source)):
        return {"fills": kept_fills(take), "cutoff": kept_cutoff(take)}
    return {}


def fills_kept(context: bpy.types.Context) -> str:
    """What a relabelling left of the active take's fills, as the end of a sentence; empty where there were none."""
    fills = context.window_manager.mocap_autolabel.fills
    lost = sum(bool(fill.reason) for fill in fills)
    holding = f"; {len(fills) - lost} fills hold" if fills else ""
    return holding + (f", {lost} no longer fit and are left out" if lost else "")


def wanted_markers(context: bpy.types.Context, stored: Stored, extent: str) -> tuple[int, ...] | None:
    """The indices of the markers that an operator is about, None for all."""
    names = selected_markers(context)
    if extent == "MARKER" and not names:
        raise InputError("no marker is selected; expected those whose gaps are meant")
    return None if extent == "TAKE" or not names else tuple(stored.names.index(name) for name in names)


class MOCAP_AUTOLABEL_OT_fill_gaps(OfTake, LongWork, bpy.types.Operator):
    """Fill gaps by what the rest of the take says; what was measured stays, and what is filled is marked as such."""

    extent: extent_property("Which gaps to fill")
    markers: once(StringProperty, "Markers", "Names of the markers to fill, a line each; none for the extent")
    propose: once(BoolProperty, "Preview", "Only show the fills, dashed, until Keep Fills or Discard Fills is pressed")
    doing = "Filling gaps"

    def asked(self, context) -> partial:
        settings, stored = context.scene.mocap_autolabel, taken(context)
        frame = stored.index_here(context.scene.frame_float) if self.extent == "GAP" else None
        longest = settings.filling.longest if settings.filling.use_longest else None
        named = tuple(stored.words[name] for name in self.markers.splitlines() if name in stored.words)
        markers = named or wanted_markers(context, stored, self.extent)
        options = FillOptions(settings.filling.method, longest, markers, frame)
        self._of = known_by(settings.take)
        subjects = [subject_of(context, stored, one, options.method) for one in stored.performers]
        return partial(fill_subjects, stored.unfilled.markers, stored.rate, options, subjects, _rays(stored))

    def _show(self, context, filled: FilledTake) -> set[str]:
        settings = context.scene.mocap_autolabel
        if not is_take(settings.take) or self._of.isdisjoint(known_by(settings.take)):
            raise InputError("another take is shown than the one whose gaps were filled; expected it to stay")
        stored = opened.take(settings.take, context.scene)
        if not filled.gaps and not filled.left:
            raise InputError("there is no gap to fill; expected a marker that is missing, and seen elsewhere")
        new = kept_fills_of(filled, stored.names, stored.motion.frames)
        if new and self.propose:
            opened.propose(settings.take, new)
            _show_proposed(context)
        elif new:
            opened.drop_proposed(settings.take, new)
            keep_and_show(context, partial(keep_fills, fills=replaced_fills(stored.fitting, new)))
        # The gaps that were left, with the reasons; frames are Blender's.
        left, shown = left_rows(filled.left, stored.names, int(stored.motion.frames[0])), stored.clock.shown
        rows = [(gap["marker"], shown(gap["first"]), shown(gap["last"]), gap["reason"]) for gap in left]
        list_rows(context.window_manager.mocap_autolabel, "left_gaps", "name first last reason", rows)
        words = outcome_of(filled, new)
        self.report({"INFO"} if new else {"WARNING"}, words.replace("filled", "previewed") if self.propose else words)
        return {"FINISHED"} if new else {"CANCELLED"}


def _rays(stored: Stored) -> MarkerRays:
    """The rays of markers that one camera alone sees; none in a take of points."""
    if not isinstance(stored.rows, Blobs):
        return NO_RAYS
    missing = ~np.isfinite(stored.unfilled.markers).all(axis=2)
    return rays_of(stored.rows, stored.labels, stored.cameras, missing)


def subject_of(context: bpy.types.Context, stored: Stored, performer: Performer, method: str) -> SubjectMarkers:
    """A performer's markers, with the body of the marker set that is chosen for them where they are its own.

    Without one the body fills nothing; InputError where it was asked for.
    """
    try:
        markerset = chosen_markerset(row_of(context.scene.mocap_autolabel.subjects, performer.name))
    except UserError:
        markerset = None
    rows = performer.marker_rows
    own = np.arange(rows.start, rows.stop)
    index = {performer.own_name(name): place for place, name in enumerate(stored.names[rows])}
    columns = np.array([] if markerset is None else [index.get(name, -1) for name in markerset.markers], dtype=int)
    if (columns >= 0).sum() >= POSING.min_markers:
        return SubjectMarkers(own, markerset, columns)
    if method == "body":
        raise InputError("the chosen marker set is not the take's; expected the one that it was labelled by")
    return SubjectMarkers(own)


def outcome_of(filled: FilledTake, new: Sequence[KeptFill]) -> str:
    """What came of a filling, for a person to read."""
    off = [1000 * fill.expected for fill in new if fill.expected == fill.expected]
    words = f"{len(new):,} of {count_of(len(new) + len(filled.left), 'gap')} filled"
    if off:
        words += f", expected {'error' if len(off) == 1 else 'errors up to'} {max(off):.1f} mm"
    if filled.left:
        words += f"; the first that was left {filled.left[0].reason}"
    return words


def proposed(context: bpy.types.Context) -> tuple[KeptFill, ...]:
    """The fills of the active take, if there is one, that are shown and not kept yet."""
    take = context.scene.mocap_autolabel.take
    return opened.proposed_of(take, context.scene) if is_take(take) else ()


def _show_proposed(context: bpy.types.Context):
    refresh_review(context.window_manager, context.scene)
    redraw("VIEW_3D")


class OfProposed(OfTake):
    """Operators on fills that are shown and not kept yet."""

    needs = (*OfTake.needs, unless(proposed, "No fill is previewed"))
    index: once(IntProperty, "Index", "Which of the list alone, from 0; -1 for all", default=-1)

    def meant(self, context) -> list[KeptFill]:
        """The fills that are meant; InputError where there is none."""
        if self.index >= 0:
            refuse_other_lists(context)
        shown = proposed(context)
        meant = [fill for number, fill in enumerate(shown) if self.index in (-1, number)]
        if not meant:
            raise InputError(f"there is no fill {self.index + 1}; expected one of the {len(shown)} that are previewed")
        return meant


class MOCAP_AUTOLABEL_OT_keep_fills(OfProposed, bpy.types.Operator):
    """Fill the gaps as the preview shows it."""

    def work(self, context):
        fills = replaced_fills(taken(context).fitting, self.meant(context))
        keep_and_show(context, partial(keep_fills, fills=fills))
        redraw("VIEW_3D")


@operator(of=OfProposed, options={"REGISTER"})  # nothing of the file is changed
def discard_fills(self, context):
    """Leave the gaps that the preview shows filled."""
    opened.drop_proposed(context.scene.mocap_autolabel.take, self.meant(context))
    _show_proposed(context)


@operator(
    unless(lambda context: fills_text(context.scene.mocap_autolabel.take), "Nothing was filled"),
    of=OfTake,
    extent=extent_property("Which fills to take back"),
    index=once(IntProperty, "Index", "Which of the list alone, from 0; -1 for the extent", default=-1),
)
def take_back_fills(self, context):
    """Make filled gaps gaps again."""
    stored, index = taken(context), self.index
    if index >= 0:
        refuse_other_lists(context)
        gone = [index] if index < len(stored.fills) else []
    else:
        markers, frame = wanted_markers(context, stored, self.extent), stored.clock.at(context.scene.frame_float)
        names = None if markers is None else [stored.names[marker] for marker in markers]
        mine = [(at, fill) for at, fill in enumerate(stored.fills) if names is None or fill.marker in names]
        gone = [number for number, fill in mine if self.extent != "GAP" or fill.first <= frame <= fill.last]
    if not gone:
        raise InputError("nothing that was filled is there; expected a filled gap")
    left = [fill for number, fill in enumerate(stored.fills) if number not in gone]
    opened.drop_proposed(context.scene.mocap_autolabel.take, [stored.fills[number] for number in gone])
    keep_and_show(context, partial(keep_fills, fills=left))
    self.report({"INFO"}, f"{count_of(len(gone), 'fill')} taken back")


@operator(of=OfTake)
def smooth(_self, context):
    """Smooth markers and body by a Butterworth filter without lag, each stretch between gaps alone; labels stay."""
    stored, cutoff = taken(context), context.scene.mocap_autolabel.filling.cutoff
    smoothed(stored.motion.markers[:0], stored.rate, cutoff)  # before anything is kept that cannot be
    keep_and_show(context, partial(keep_cutoff, cutoff=cutoff))
    follow_soon()


@operator(
    unless(lambda context: kept_cutoff(context.scene.mocap_autolabel.take) is not None, "Nothing is smoothed"),
    of=OfTake,
)
def take_back_smoothing(_self, context):
    """Show and export markers and body as they were measured again."""
    keep_and_show(context, partial(keep_cutoff, cutoff=None))
    follow_soon()
