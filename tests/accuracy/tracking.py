# SPDX-License-Identifier: GPL-3.0-or-later
"""The first paper's future tracker: how often a subject is lost at 60 Hz, by iterations a frame."""

from functools import partial
from unittest.mock import patch

from addon.core.blobs import tracking
from addon.core.simulation.simulate import CaptureOptions

from .tables import share, table
from .walking import walking

STEPS = (1, 2, 5)  # 2 are used
# Where and by how many cameras, room, fewest and most cameras, what they see, iterations tried.
CAPTURES = (
    ("vicon12, 6 to 8", "vicon12", (6, 8), CaptureOptions(), STEPS),
    (
        "vicon12, 6 to 8, blobs off by 2 px, a fifth lost",
        "vicon12",
        (6, 8),
        CaptureOptions(noise=2.0, dropout=0.2),
        (2,),
    ),
    ("ring, 4", "ring", (4, 4), CaptureOptions(), (2,)),
    ("ring, 3", "ring", (3, 3), CaptureOptions(), (2,)),
    ("ring, 2", "ring", (2, 2), CaptureOptions(), (2,)),
)


def run_tracking(plan):
    """A34: whole takes at 60 Hz with fewer and more iterations a frame than are used."""
    from .runs import measured, milliseconds

    rows, takes = [], max(plan.count // 10, 2)
    for set_name in plan.sets:
        for title, room, cameras, options, tried in CAPTURES:
            trials = partial(walking, options=options, room=room, cameras=cameras)
            for steps in tried:
                with patch.object(tracking, "FOLLOWING_STEPS", steps):
                    score, labellers = measured(plan, set_name, trials, takes, 60.0)
                frames = sum(labeller.frames for labeller in labellers)
                lost, nobody = (sum(getattr(one, what) for one in labellers) for what in ("lost", "nobody"))
                total = score.counts
                cells = [score.takes, f"{lost} ({1000 * lost / frames:.2f})", share(nobody, frames)]
                cells.append(share(total.given - total.right, total.given, 3))
                cells.append(f"{100 * total.found / total.present:.2f} %")
                rows.append([set_name, title, steps, *cells, f"{1000 / milliseconds(labellers):.0f}"])
    print(f"\n### Following walks and turns at 60 Hz, ghosts ({plan.people()})\n")
    names = ("set", "room, cameras", "iterations a frame", "takes", "lost (for 1,000 frames)", "frames with nobody")
    print(table((*names, "wrong labels", "recall", "frames a second"), rows))
