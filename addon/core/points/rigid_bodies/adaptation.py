# SPDX-License-Identifier: GPL-3.0-or-later
"""The model adapted to the subject of a take: one that it knows, or one whose rigid bodies the take itself must tell."""

from dataclasses import dataclass, replace

import numpy as np

from ...data.models import Model
from ...data.takes import BY_TRAJECTORY, NO_MARKER, NO_STEP, Labels, Suspect, Verdict
from ..deciding import once
from .person import Person, recognise
from .structure import learn_structure

MOVES = 0.99  # confidence of a name that only the motion of the whole take tells


@dataclass(frozen=True, eq=False)
class Adaptation:
    """The model as it is for a take, and what the take itself says; `person` is None where the model must do."""

    model: Model
    person: Person | None = None

    @property
    def stranger(self) -> bool:
        """Whether the rigid bodies in the take are not the model's own."""
        return self.person is not None and self.person.known is False


def adapt(model: Model, points: np.ndarray, tracklet: np.ndarray, rate: float) -> Adaptation:
    """Looks at how the points (T, P, 3) m of a take move together, with the tracklet (T, P) of each.

    Only a set on rigid bodies can be looked at so, and only a model that keeps what it was trained on.
    """
    likelihood = model.likelihood
    if likelihood is None or likelihood.rigid_bodies is None or not model.training_takes:
        return Adaptation(model)
    structure = learn_structure(likelihood.rigid_bodies, list(model.subjects.values()))
    person = recognise(structure, likelihood.rigid_bodies, points, tracklet, rate)
    if person.known is not False:
        return Adaptation(model, person)
    own = replace(likelihood, rigid_bodies=person.rigid_bodies)
    return Adaptation(replace(model, likelihood=own), person)


def borne_out(verdict: Verdict, adaptation: Adaptation, first_frame: int) -> Verdict:
    """The names (T, P) without those that the motion of the whole take does not bear out, and what to say of that."""
    person, names, labels = adaptation.person, adaptation.model.markerset.markers, verdict.labels
    if person is None:
        return verdict
    if not adaptation.stranger:
        said = _of_form_alone(person, first_frame) + _of_props(person, first_frame)
        return Verdict(labels, said + verdict.suspects)
    found = _found(person)
    moving = person.marker != NO_MARKER
    other = moving & labels.named & (person.marker != labels.marker)
    kept = np.append(found, True)[labels.marker] & ~other
    # What only moves like a marker has its name from that; a rigid body needs three markers to be known by its form.
    moves = ~labels.named & moving
    sure = np.where(kept, labels.confidence, 0.0) + np.where(moves, MOVES, 0.0)
    marker = np.where(moves, person.marker, np.where(kept, labels.marker, NO_MARKER))
    marker = once(marker, sure, len(names))
    step = np.where(marker == labels.marker, labels.step, BY_TRAJECTORY)
    given = marker != NO_MARKER
    checked = Labels(marker, np.where(given, step, NO_STEP), np.where(given, sure, 0.0))
    named = found.copy()
    named[person.marker[moving]] = True
    suspects = (
        _of_stranger(person, names, named, first_frame)
        + _of_props(person, first_frame)
        + _of_contradictions(person, np.where(other, labels.marker, NO_MARKER), names, first_frame)
        + verdict.suspects
    )
    return Verdict(checked, suspects)


def _found(person: Person) -> np.ndarray:
    """(M,) True for markers that single frames may name: on a plate of known form, or with a place of their own."""
    found = np.zeros(len(person.sure), dtype=bool)
    found[[marker for group in person.rigid_bodies.groups for marker in group]] = True
    found[person.lone[person.lone != NO_MARKER]] = True
    # Beside a plate whose form is known, such as an ankle at its foot.
    for marker in np.flatnonzero(person.sure):
        mates = person.sure & (person.placed.rigid_body == person.placed.rigid_body[marker])
        found[marker] |= found[mates].any()
    return found


def _of_stranger(person: Person, names, found: np.ndarray, first_frame: int) -> tuple[Suspect, ...]:
    """What holds for the whole take of a subject in other plates than the model's."""
    rigid_bodies = len(person.group)
    sure = int((person.group >= 0).sum())
    recognised = f"{sure} of {rigid_bodies} were recognised by how they move, and their forms taken from this take"
    said = [f"the plates are not those of the training, or sit elsewhere: {recognised}"]
    missing = [names[marker] for marker in np.flatnonzero(~found)]
    if missing:
        said.append(f"not found for sure, so unnamed in the whole take: {' '.join(missing)}")
    return tuple(Suspect(first_frame, first_frame + len(person.part) - 1, words) for words in said)


def _of_form_alone(person: Person, first_frame: int) -> tuple[Suspect, ...]:
    """That nobody checked whether the plates are on the limbs of the training, where the motion does not tell."""
    if person.known is not None:
        return ()
    sure = int((person.group >= 0).sum())
    words = (
        f"how the plates move tells only {sure} of {len(person.group)}, so names rest on the plates' forms alone: look "
        "whether each is on its limb"
    )
    return (Suspect(first_frame, first_frame + len(person.part) - 1, words),)


def _of_props(person: Person, first_frame: int) -> tuple[Suspect, ...]:
    """Things in the room that nobody wears."""
    columns = np.flatnonzero(person.prop.any(axis=0))
    if not len(columns):
        return ()
    words = f"{len(columns)} trajectories stand still while the subject moves: no markers of the set"
    return (Suspect(first_frame, first_frame + len(person.part) - 1, words),)


def _of_contradictions(person: Person, said: np.ndarray, names, first_frame: int) -> tuple[Suspect, ...]:
    """Trajectories that moved as one marker and were named as another, (T, P) where they lost their names."""
    found = []
    for column in np.flatnonzero((said != NO_MARKER).any(axis=0)).tolist():
        frames = np.flatnonzero(said[:, column] != NO_MARKER)
        moves, looks = names[person.marker[frames[0], column]], names[said[frames[0], column]]
        words = f"moves as {moves} and looks like {looks}, so it stays unnamed"
        found.append(Suspect(int(frames[0]) + first_frame, int(frames[-1]) + first_frame, words, column))
    return tuple(found)
