# SPDX-License-Identifier: GPL-3.0-or-later
"""Events and force plates of a C3D file, in metres with z up."""

import numpy as np

from ...core.data.lanes import blocks
from ...core.geometry.force_plates import NO_LAB, ForcePlate, LabRecords, force_on_plate
from .file import C3dFile, TrialFile, as_text, words_of
from .kept import EVENT_COUNT, EVENT_KEY, EVENT_LABELS, EVENT_TIMES, NEW_KEY, Kept, kept_of

CHANNELS = {1: 6, 2: 6, 3: 8, 4: 6}  # of each kind of plate; format
NEWTON_METRES = ("nm", "n.m", "n*m", "n-m")
MAX_PLATES = 64  # memory: a room has ten at most
MAX_EVENT_FRAME = 2**31  # Blender's whole numbers; format


def read_lab(trial: TrialFile, rate: float) -> LabRecords:
    """What the file of a take says beside its points, of `rate` frames a second; InputError where it changed since."""
    with kept_of(trial, trial.layout.first) as kept, np.errstate(all="ignore"):
        if kept is None or trial.turn is None:  # of no take
            return NO_LAB
        events = [(name, frame) for name, frame in _events(kept, rate) if abs(frame) < MAX_EVENT_FRAME]
        return LabRecords(trial.layout.first, tuple(events), tuple(_plates(kept, trial.metre, trial.turn)))


def _events(kept: Kept, rate: float) -> list[tuple[str, float]]:
    """Each event's name and frame: those of the group EVENT, whose times count from frame 1, else the header's."""
    file, texts = kept.file, kept.file.all_texts()
    times, labels = _rows(file.numbers("EVENT:TIMES"), 2), texts.get("EVENT:LABELS", [])
    if len(times) and labels:
        contexts = texts.get("EVENT:CONTEXTS", [])
        names = [" ".join(filter(None, both)) for both in zip([*contexts, *[""] * len(labels)], labels, strict=False)]
        return list(zip(names, (1 + times @ [60, 1] * rate).tolist(), strict=False))
    count = file.word(EVENT_COUNT) if file.word(EVENT_KEY) == NEW_KEY else 0
    frames = kept.trial.layout.first + file.reals(file.content[EVENT_TIMES])[:count].astype(float) * rate
    letters = file.content[EVENT_LABELS]
    return [(as_text(letters[4 * at : 4 * at + 4]), frame) for at, frame in enumerate(frames.tolist())]


def _plates(kept: Kept, metre: float, turn: np.ndarray) -> list[ForcePlate]:
    """Those whose corners are known; without force where that cannot be told."""
    file = kept.file
    own = {name: file.numbers(f"FORCE_PLATFORM:{name}") for name in ("TYPE", "CORNERS", "ORIGIN", "CAL_MATRIX")}
    corners, origins, matrices = _rows(own["CORNERS"], 12), _rows(own["ORIGIN"], 3), _rows(own["CAL_MATRIX"], 36)
    wanted = file.parameters.get("FORCE_PLATFORM:CHANNEL")
    width = wanted.dimensions[0] if wanted and wanted.dimensions else 1
    channels = _rows(file.numbers("FORCE_PLATFORM:CHANNEL"), width)
    found = []
    for plate in range(min(file.whole("FORCE_PLATFORM:USED"), len(corners), MAX_PLATES)):
        place = corners[plate].reshape(4, 3)
        if not np.linalg.norm(np.cross(place[0] - place[1], place[0] - place[3])) > 0 or not np.isfinite(place).all():
            continue
        force = np.zeros((kept.trial.layout.frames, 3))
        acting = np.full_like(force, np.nan)
        kind = own["TYPE"][plate].item() if plate < len(own["TYPE"]) else 0
        known = plate < min(len(origins), len(channels)) and (kind != 4 or plate < len(matrices))
        if known and kind in CHANNELS:
            signals = _signals(kept, channels[plate].astype(int)[: CHANNELS[kind]], kind)
            if signals is not None and signals.shape[1] == CHANNELS[kind]:
                matrix = matrices[plate].reshape(6, 6) if kind == 4 else np.eye(6)
                force, acting = force_on_plate(kind, place, origins[plate], signals, matrix)
        found.append(ForcePlate(place * metre @ turn.T, force @ turn.T, acting * metre @ turn.T))
    return found


def _signals(kept: Kept, channels: np.ndarray, kind: int) -> np.ndarray | None:
    """(F, C) the first sample in each frame of some channels, counted from 1; None where there are no such."""
    file, layout = kept.file, kept.trial.layout
    used = file.whole("ANALOG:USED") or layout.analog // max(file.word(9), 1)
    scale, offset = (_parts(file, f"ANALOG:{name}") for name in ("SCALE", "OFFSET"))
    at = channels - 1
    if not len(at) or at.min() < 0 or at.max() >= min(used, layout.analog, len(scale), len(offset)):
        return None
    columns = 4 * layout.points + at
    raw = np.concatenate([words_of(file, layout, part)[:, columns] for part in blocks(layout.frames, layout.stride)])
    unsigned = "UNSIGNED" in map(str.upper, file.all_texts().get("ANALOG:FORMAT", []))
    raw, zero = raw.astype(float), offset[at].astype(float)
    if unsigned and file.scale > 0:
        raw %= 65536
    if not unsigned:
        zero = (zero + 32768) % 65536 - 32768
    values = (raw - zero) * scale[at] * file.number("ANALOG:GEN_SCALE", 1)
    units = file.all_texts().get("ANALOG:UNITS", [])
    if kind != 4 and at[3] < len(units) and units[at[3]].lower() in NEWTON_METRES:
        values[:, 3:] /= kept.trial.metre  # else moments are in the unit of points
    return values


def _parts(file: C3dFile, name: str) -> np.ndarray:
    """The numbers of a parameter and of those that go on from it: NAME2, NAME3 and so on."""
    found, number = [file.numbers(name)], 2
    while f"{name}{number}" in file.parameters:
        found.append(file.numbers(f"{name}{number}"))
        number += 1
    return np.concatenate(found)


def _rows(values: np.ndarray, width: int) -> np.ndarray:
    """(N, width) numbers in rows, without what fills none."""
    return values[: len(values) // max(width, 1) * width].astype(float).reshape(-1, max(width, 1))
