# SPDX-License-Identifier: GPL-3.0-or-later
"""Who wears the marker set in a take: somebody the model knows, or somebody whose plates the take itself must tell."""

from dataclasses import dataclass, replace

import numpy as np

from ..core.groups import Person, learn_structure, recognise
from ..core.models import Model
from ..core.takes import NO_MARKER, Suspect
from .naming import Decided


@dataclass(frozen=True, eq=False)
class Wearer:
    """The model as it is for this take, and what the take itself says; `person` is None where the model must do."""

    model: Model
    person: Person | None = None

    @property
    def stranger(self) -> bool:
        """Whether the plates in the take are not the model's own."""
        return self.person is not None and self.person.known is False


def find_wearer(model: Model, method: str, points: np.ndarray, piece: np.ndarray, rate: float) -> Wearer:
    """Looks at how the points (T, P, 3) m of a take move together, with the piece of trajectory (T, P) of each.

    Only a set on plates can be looked at so, and only a model that keeps what it was trained on.
    """
    evidence = model.markerset.evidence
    if method != "evidence" or evidence is None or evidence.plates is None or not model.lessons:
        return Wearer(model)
    structure = learn_structure(evidence.plates, [lesson.points.astype(float) for lesson in model.lessons])
    person = recognise(structure, evidence.plates, points, piece, rate)
    if person.known is not False:
        return Wearer(model, person)
    own = replace(model.markerset, evidence=replace(evidence, plates=person.plates))
    return Wearer(replace(model, markerset=own), person)


def checked(decided: Decided, wearer: Wearer, first_frame: int) -> Decided:
    """The names (T, P) without those that the motion of the whole take does not bear out, and what to say of that."""
    person, names = wearer.person, wearer.model.markerset.markers
    if person is None:
        return decided
    if not wearer.stranger:
        return replace(decided, suspects=_of_props(person, first_frame) + decided.suspects)
    found = np.zeros(len(names) + 1, dtype=bool)
    found[np.flatnonzero(person.sure)] = True
    found[person.lone[person.lone >= 0]] = True
    unsure = ~found[decided.marker]
    other = (person.marker >= 0) & (decided.marker != NO_MARKER) & (person.marker != decided.marker)
    gone = unsure | other
    marker = np.where(gone, NO_MARKER, decided.marker)
    suspects = (
        _of_stranger(person, wearer.model, found[:-1], first_frame)
        + _of_props(person, first_frame)
        + _of_contradictions(person, np.where(other, decided.marker, NO_MARKER), names, first_frame)
        + decided.suspects
    )
    return replace(decided, marker=marker, confidence=np.where(gone, 0.0, decided.confidence), suspects=suspects)


def _of_stranger(person: Person, model: Model, found: np.ndarray, first_frame: int) -> tuple[Suspect, ...]:
    """What holds for the whole take of a subject in other plates than the model's."""
    names = model.markerset.markers
    plates = len(person.group)
    sure = int((person.group >= 0).sum())
    recognised = f"{sure} of {plates} were recognised by how they move, and their forms taken from this take"
    said = [f"the plates are not those of the training, or sit elsewhere: {recognised}"]
    missing = [names[marker] for marker in np.flatnonzero(~found)]
    if missing:
        said.append(f"not found for sure, so unnamed in the whole take: {' '.join(missing)}")
    return tuple(Suspect(first_frame, first_frame + len(person.part) - 1, words) for words in said)


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
    for column in np.flatnonzero((said != NO_MARKER).any(axis=0)):
        frames = np.flatnonzero(said[:, column] != NO_MARKER)
        moves, looks = names[person.marker[frames[0], column]], names[said[frames[0], column]]
        words = f"trajectory {column} moves as {moves} and looks like {looks}, so it stays unnamed"
        found.append(Suspect(int(frames[0]) + first_frame, int(frames[-1]) + first_frame, words))
    return tuple(found)
