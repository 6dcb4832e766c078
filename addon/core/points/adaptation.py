# SPDX-License-Identifier: GPL-3.0-or-later
"""The model adapted to a take: to a subject that it knows, or to one whose rigid bodies the take itself must show."""

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from ..data.lanes import Lanes, standing_in
from ..data.made import Table
from ..data.takes import BY_TRAJECTORY, NO_MARKER, NO_STEP, Labels, Suspect, Verdict
from .deciding import once
from .models import Model

if TYPE_CHECKING:  # most sets are on no rigid bodies, and need none of it
    from .rigid_bodies.recognition import Recognition


@dataclass(frozen=True, eq=False)
class Adaptation:
    """The model as it is for a take, and what the take itself says; `recognition` is None where the model must do."""

    model: Model
    recognition: "Recognition | None" = None

    @property
    def other_layout(self) -> bool:
        """Whether the rigid bodies in the take are not the model's own, or sit elsewhere."""
        return self.recognition is not None and self.recognition.known is False


def adapt(model: Model, points: Table, tracklet: np.ndarray, rate: float) -> Adaptation:
    """Looks at how the points (T, P, 3) m of a take move together, with the tracklet (T, P) of each.

    Only a set on rigid bodies can be looked at so, and only a model that keeps what it was trained on.
    """
    likelihood, structure = model.likelihood, model.structure
    if likelihood is None or likelihood.rigid_bodies is None or structure is None:
        return Adaptation(model)
    from .rigid_bodies.recognition import recognise

    recognition = recognise(structure, likelihood.rigid_bodies, points, tracklet, rate)
    if recognition.known is not False:
        return Adaptation(model, recognition)
    own = replace(likelihood, rigid_bodies=recognition.rigid_bodies)
    return Adaptation(replace(model, likelihood=own), recognition)


def borne_out(verdict: Verdict, adaptation: Adaptation, first_frame: int, lanes: Lanes | None = None) -> Verdict:
    """The names (T, L) without those that the motion of the whole take does not bear out, and what to say of that."""
    seen, names, labels = adaptation.recognition, adaptation.model.markerset.markers, verdict.labels
    if seen is None:
        return verdict
    from .rigid_bodies.recognition import MOTION_CONFIDENCE

    if not adaptation.other_layout:
        return Verdict(labels, _of_take(seen, [], first_frame) + verdict.suspects)
    found = _found(seen)
    moving = seen.marker != NO_MARKER
    other = moving & labels.named & (seen.marker != labels.marker)
    kept = np.append(found, True)[labels.marker] & ~other
    # What only moves like a marker has its name from that; a rigid body needs three markers to be known by its form.
    moves = ~labels.named & moving
    sure = np.where(kept, labels.confidence, 0.0) + np.where(moves, MOTION_CONFIDENCE, 0.0)
    marker = np.where(moves, seen.marker, np.where(kept, labels.marker, NO_MARKER))
    marker = once(marker, sure, len(names), lanes)
    step = np.where(marker == labels.marker, labels.step, BY_TRAJECTORY)
    given = marker != NO_MARKER
    checked = Labels(marker, np.where(given, step, NO_STEP), np.where(given, sure, 0.0))
    found[seen.marker[moving]] = True
    missing = [names[marker] for marker in np.flatnonzero(~found)]
    contradicted = _of_contradictions(seen, np.where(other, labels.marker, NO_MARKER), names, first_frame, lanes)
    return Verdict(checked, _of_take(seen, missing, first_frame) + contradicted + verdict.suspects)


def _found(seen: "Recognition") -> np.ndarray:
    """(M,) True for markers that single frames may name: on a rigid body of known form, or in a known place."""
    found = np.zeros(len(seen.sure), dtype=bool)
    found[[marker for group in seen.rigid_bodies.members for marker in group]] = True
    found[seen.single[seen.single != NO_MARKER]] = True
    # Beside a rigid body whose form is known, such as an ankle at its foot.
    for marker in np.flatnonzero(seen.sure):
        mates = seen.sure & (seen.placed.rigid_body == seen.placed.rigid_body[marker])
        found[marker] |= found[mates].any()
    return found


def _of_take(seen: "Recognition", missing: list[str], first_frame: int) -> tuple[Suspect, ...]:
    """What is true of the whole take, where these markers are `missing` in it."""
    words = []
    of_all = f"{int((seen.cluster >= 0).sum())} of {len(seen.cluster)}"
    if seen.known is False:
        recognised = f"{of_all} were recognised by how they move, and their forms taken from this take"
        words.append(f"the rigid bodies are not those of the training, or sit elsewhere: {recognised}")
        if missing:
            words.append(f"not found for sure, so unnamed in the whole take: {' '.join(missing)}")
    elif seen.known is None:
        words.append(
            f"how the rigid bodies move tells only {of_all}, so names rest on the rigid bodies' forms alone: "
            "look whether each is on its limb"
        )
    return tuple(Suspect(first_frame, first_frame + len(seen.tracklet) - 1, one) for one in words)


def _of_contradictions(
    seen: "Recognition", named: np.ndarray, names, first_frame: int, lanes: Lanes | None
) -> tuple[Suspect, ...]:
    """Trajectories that moved as one marker and were named as another, (T, L) where they lost their names."""
    found, marker = [], seen.marker
    standing = standing_in(lanes, named.shape)
    for _, span, lane in standing.each_alone():
        frames = np.flatnonzero(named[span, lane] != NO_MARKER) + span.start
        if len(frames):
            moves, looks = names[marker[frames[0], lane]], names[named[frames[0], lane]]
            words = f"moves as {moves} and looks like {looks}, so it stays unnamed"
            found.append(Suspect(int(frames[0]) + first_frame, int(frames[-1]) + first_frame, words, lane))
    return tuple(found)
