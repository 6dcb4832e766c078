# SPDX-License-Identifier: GPL-3.0-or-later
"""How marker sets in words name recorded people: python -m tests.accuracy.layouts

Each published layout on takes of people who wear its markers or most of them, cut to pieces with ghosts as whole takes
are. Prints the table of results/layouts.json.
"""

import sys
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
from threadpoolctl import threadpool_limits

from addon.core.data.progress import finished
from addon.core.points.models import Model
from addon.core.training.described import described, learned
from addon.io.layouts import open_layout
from addon.jobs.models import known_bodies
from scripts.results import markdown

from . import people, whole_takes
from .one_frame import STRANGERS, counts_of, shares
from .registry import labelled_points

FRAMES = 1500
IN_PLUGIN_GAIT = ("nick", "pete", "jack_bat", "player1", "pigsimple_normal1", "btk_walk")
# What else labs call a marker of a layout.
AS_SPORTS = {
    "L_HEAD": "HeadL", "R_HEAD": "HeadR", "SGL": "HeadFront", "SME": "Chest", "TV2": "SpineThoracic2",
    "TV12": "SpineThoracic12", "L_IAS": "WaistLFront", "R_IAS": "WaistRFront", "SACR": "WaistBack",
} | {
    f"{side}_{theirs}": side + ours
    for side in "LR"
    for theirs, ours in (
        ("SAE", "ShoulderTop"), ("HLE", "ElbowOut"), ("HME", "ElbowIn"), ("RSP", "WristIn"), ("USP", "WristOut"),
        ("HM2", "Hand2"), ("PAS", "ThighFrontLow"), ("FLE", "KneeOut"), ("TTC", "ShinFrontHigh"), ("FAL", "AnkleOut"),
        ("FCC", "HeelBack"), ("FM2", "Forefoot2"),
    )
}  # fmt: skip
FOREARMS = {"RFRA": "RFRM", "LFRA": "LFRM"}
# Plates of four on thighs and shanks.
AS_CAST = {
    f"{side}.{theirs}": side + ours
    for side in "LR"
    for theirs, ours in (
        ("ASIS", "IAS"), ("PSIS", "IPS"), ("Great.Tro", "GT"), ("Knee.Lat", "LE"), ("Knee.Med", "ME"),
        ("Ankle.Lat", "LM"), ("Ankle.Med", "MM"), ("Heel.Upper", "CA"), ("Toe.Med", "FM"), ("Toe.Lat", "VM"),
        ("Thigh.Upper.Ant", "T1"), ("Thigh.Upper.Post", "T2"), ("Thigh.Lower.Ant", "T3"), ("Thigh.Lower.Post", "T4"),
        ("Shank.Upper.Ant", "S1"), ("Shank.Upper.Post", "S2"), ("Shank.Lower.Ant", "S3"), ("Shank.Lower.Post", "S4"),
    )
}  # fmt: skip


def trials() -> Iterator[tuple[str, people.Take]]:
    """Layouts and takes in their markers, all others left out."""
    for name in IN_PLUGIN_GAIT:
        for layout in ("plugin_gait", "plugin_gait_lower"):
            yield layout, named(STRANGERS / f"plugin_gait/{name}.c3d", FOREARMS)
    yield "plugin_gait_feet", named(STRANGERS / "plugin_gait/pigsimple_normal1.c3d", FOREARMS)
    for name in whole_takes.WALKS:
        yield "helen_hayes", whole_takes.in_gait15(name)
    for name in ("S02", "S04", "S06"):
        for layout in ("ior", "cast"):
            yield layout, named(STRANGERS / f"plates/{name}.trc", AS_CAST)
    yield "qualisys_sports", named(people.DATA / "blobs/qualisys_run/run.c3d", AS_SPORTS)
    for name in ("p1", "p2"):
        yield "frontwaist53", named(people.DATA / people.OTHERS[name], {})


def named(path: Path, theirs: dict[str, str]) -> people.Take:
    """A take in a layout's names."""
    take = people.read(path, path.stem)
    return replace(take, markers=tuple(theirs.get(name, name) for name in take.markers))


def model_of(name: str) -> Model:
    """The model that a published layout makes."""
    bodies = known_bodies()
    return finished(learned(described(open_layout(name), bodies), bodies))[0]


def main():
    """Prints how each take was named."""
    people.need_people()
    models, rows = {}, []
    for name, take in trials():
        model = models[name] = models.get(name) or model_of(name)
        worn = tuple(marker for marker in model.markerset.markers if marker in take.markers)
        shown = take.of(worn).part(0, FRAMES)
        shown = replace(shown, xyz=shown.xyz[np.isfinite(shown.xyz[..., 0]).sum(axis=1) * 2 >= len(worn)])
        with threadpool_limits(1, user_api="blas"):
            outcome = labelled_points(*whole_takes.anonymous(shown, model.markerset.markers), model)
        rows.append([name, take.subject, f"{len(worn)} of {len(model.markerset)}", *shares(counts_of(outcome))])
        print(*rows[-1], outcome.refused, file=sys.stderr, flush=True)
    print(markdown(["layout", "take", "markers worn", "labels", "right", "wrong"], rows))


if __name__ == "__main__":
    main()
