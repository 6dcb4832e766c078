# SPDX-License-Identifier: GPL-3.0-or-later
"""Lists of edits of a small take, made up at random: M markers A, B, … on P trajectories over T frames."""

import numpy as np
from hypothesis import strategies as st

from addon.core.data.takes import BY_LIKELIHOOD, NO_MARKER, NO_STEP, Labels, Points
from addon.core.edits.applying import Cells, cells_of_take
from addon.core.edits.kinds import AssignPoint, Delete, Edits, Place, Right, Swap, UnlabelMarker, UnlabelPoint

FRAMES, POINTS, FIRST = 6, 5, 10
NAMES = ("A", "B", "C", "D")
INDEX = {name: index for index, name in enumerate(NAMES)}
COLUMNS = np.array([2, 3, 5, 7, 11])  # of the file, some of which are no markers'

frame = st.integers(FIRST, FIRST + FRAMES - 1)
frames = st.none() | st.tuples(frame, frame).map(lambda two: (min(two), max(two)))
marker = st.sampled_from(NAMES)
point = st.sampled_from(COLUMNS.tolist())
xyz = st.tuples(*[st.floats(-5, 5)] * 3)

edit = st.one_of(
    st.builds(AssignPoint, point, marker, frames=frames),
    st.builds(UnlabelMarker, marker, frames=frames),
    st.builds(UnlabelPoint, point, frames=frames),
    st.builds(Swap, st.permutations(NAMES).map(lambda names: (names[0], names[1])), frames=frames),
    st.builds(Delete, point, frames=frames),
    st.builds(Place, marker, frame, xyz),
    st.builds(Right, marker, frames=frames),
)
edits = st.lists(edit, max_size=6).map(lambda items: Edits(tuple(items)))


def take(seed: int) -> tuple[Labels, np.ndarray]:
    """Labels that have each marker once a frame at most, of points (T, P) that are there four times in five."""
    rng = np.random.default_rng(seed)
    present = rng.random((FRAMES, POINTS)) < 0.8
    names = [*range(len(NAMES)), NO_MARKER, NO_MARKER]
    given = np.array([rng.permutation(names)[:POINTS] for _ in range(FRAMES)])
    return named(np.where(present, given, NO_MARKER)), present


def cells_of(present: np.ndarray) -> Cells:
    """What edits of these points (T, P) go by."""
    xyz = np.where(present[..., None], np.zeros(3), np.nan)
    points = Points(("",) * POINTS, xyz, xyz[..., 0], 100.0, FIRST, columns=COLUMNS)
    return cells_of_take(points, INDEX, len(NAMES))


def named(marker: np.ndarray) -> Labels:
    """Labels (T, P) of these markers, all from frames on their own."""
    some = marker != NO_MARKER
    return Labels(marker, np.where(some, BY_LIKELIHOOD, NO_STEP), np.where(some, 0.9, 0.0))
