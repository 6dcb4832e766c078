# SPDX-License-Identifier: GPL-3.0-or-later
"""From a file to names of a marker set that was learned before, by pointer in a real Blender's window; counted."""

import sys
import time
from collections.abc import Iterator
from pathlib import Path

import bpy

sys.path.insert(0, str(Path(__file__).resolve().parent))

import stage
from stage import settings, state, window

OPEN, LABEL = "mocap_autolabel.import_take", "mocap_autolabel.label"


def walk(seen: dict) -> Iterator[float]:
    """What is not counted is what a person has already: the set, in the folder of their own."""
    bpy.context.preferences.addons[stage.EXTENSION].preferences.markerset_folder = stage.TASK["own"]
    yield from window.open_tab("Mocap")
    begun = time.monotonic()
    yield from window.choose(OPEN, stage.TASK["points"])  # two clicks: the button, and Open Take in the browser
    yield from window.until(lambda: settings().subjects.found and not state().doing)
    seen["found"] = settings().subjects.found
    yield from window.screenshot("1-found")
    places = yield from window.scroll_to(LABEL)
    yield from window.click(*places[LABEL])  # the third
    yield from window.until(lambda: settings().take is not None and not state().doing)
    seen["seconds"] = time.monotonic() - begun
    take, _ = stage.now()
    seen["named"], seen["points"] = int(take.labels.named.sum()), len(take.rows)
    yield from window.screenshot("2-named")


stage.play(walk)
