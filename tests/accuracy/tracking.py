# SPDX-License-Identifier: GPL-3.0-or-later
"""The first paper's future tracker: how often a subject is lost at 60 Hz, by iterations a frame."""

from dataclasses import replace
from functools import partial
from unittest.mock import patch

from addon.core.blobs import tracking

from .tables import share, table
from .walking import walking

STEPS = (1, 2, 5)
# Title, room, fewest and most cameras.
ROOMS = (("vicon12", "vicon12", (6, 8)), ("ring", "ring", (4, 4)))


def run_tracking(plan):
    """A34: whole takes at 60 Hz with fewer and more iterations a frame than are used."""
    from .runs import measured, milliseconds

    rows, takes = [], max(plan.count // 10, 2)
    for set_name in plan.sets:
        for title, room, cameras in ROOMS:
            trials = partial(walking, room=room, cameras=cameras)
            for steps in STEPS if room == "vicon12" else (tracking.TRACKING.fit_steps,):
                with patch.object(tracking, "TRACKING", replace(tracking.TRACKING, fit_steps=steps)):
                    score, labellers = measured(plan, set_name, trials, takes, 60.0)
                frames = sum(labeller.frames for labeller in labellers)
                lost, nobody = (sum(getattr(one, what) for one in labellers) for what in ("lost", "nobody"))
                total = score.counts
                cells = [score.takes, f"{lost} ({1000 * lost / frames:.2f})", share(nobody, frames)]
                cells.append(share(total.given - total.right, total.given, 3))
                cells.append(f"{100 * total.found / total.present:.2f} %")
                few, most = cameras
                seen_by = f"{title}, {few} to {most}" if few < most else f"{title}, {few}"
                rows.append([set_name, seen_by, steps, *cells, f"{1000 / milliseconds(labellers):.0f}"])
    print(f"\n### Following walks and turns at 60 Hz, ghosts ({plan.people()})\n")
    names = ("set", "room, cameras", "iterations a frame", "takes", "lost (for 1,000 frames)", "frames with nobody")
    print(table((*names, "wrong labels", "recall", "frames a second"), rows))
