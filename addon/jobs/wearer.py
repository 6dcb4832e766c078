# SPDX-License-Identifier: GPL-3.0-or-later
"""Who wears the marker set in a take: somebody the model knows, or somebody whose plates the take itself must tell."""

from dataclasses import dataclass, replace

import numpy as np

from ..core.data.models import Model
from ..core.data.takes import NO_MARKER, Suspect
from ..core.points.rigid_bodies import Person, learn_structure, recognise
from .naming import Decided, once

MOVES = 0.99  # confidence of a name that only the motion of the whole take tells


@dataclass(frozen=True, eq=False)
class Wearer:
    """The model as it is for this take, and what the take itself says; `person` is None where the model must do."""

    model: Model
    person: Person | None = None

    @property
    def stranger(self) -> bool:
        """Whether the plates in the take are not the model's own."""
        return self.person is not None and self.person.known is False


def find_wearer(model: Model, method: str, points: np.ndarray, tracklet: np.ndarray, rate: float) -> Wearer:
    """Looks at how the points (T, P, 3) m of a take move together, with the tracklet (T, P) of each.

    Only a set on plates can be looked at so, and only a model that keeps what it was trained on.
    """
    likelihood = model.markerset.likelihood
    if method != "evidence" or likelihood is None or likelihood.rigid_bodies is None or not model.training_takes:
        return Wearer(model)
    structure = learn_structure(likelihood.rigid_bodies, list(model.subjects.values()))
    person = recognise(structure, likelihood.rigid_bodies, points, tracklet, rate)
    if person.known is not False:
        return Wearer(model, person)
    own = replace(model.markerset, likelihood=replace(likelihood, rigid_bodies=person.rigid_bodies))
    return Wearer(replace(model, markerset=own), person)


def checked(decided: Decided, wearer: Wearer, first_frame: int) -> Decided:
    """The names (T, P) without those that the motion of the whole take does not bear out, and what to say of that."""
    person, names = wearer.person, wearer.model.markerset.markers
    if person is None:
        return decided
    if not wearer.stranger:
        said = _of_form_alone(person, first_frame) + _of_props(person, first_frame)
        return replace(decided, suspects=said + decided.suspects)
    found = _found(person)
    other = (person.marker != NO_MARKER) & (decided.marker != NO_MARKER) & (person.marker != decided.marker)
    kept = np.append(found, True)[decided.marker] & ~other
    # What only moves like a marker has its name from that; a plate needs three markers to be known by its form.
    moves = (decided.marker == NO_MARKER) & (person.marker != NO_MARKER)
    sure = np.where(kept, decided.confidence, 0.0) + np.where(moves, MOVES, 0.0)
    marker = np.where(moves, person.marker, np.where(kept, decided.marker, NO_MARKER))
    marker = once(marker, sure, len(names))
    alone = decided.alone & (marker == decided.marker)
    named = found.copy()
    named[person.marker[person.marker != NO_MARKER]] = True
    suspects = (
        _of_stranger(person, names, named, first_frame)
        + _of_props(person, first_frame)
        + _of_contradictions(person, np.where(other, decided.marker, NO_MARKER), names, first_frame)
        + decided.suspects
    )
    return Decided(marker, np.where(marker == NO_MARKER, 0.0, sure), alone, suspects)


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
