# SPDX-License-Identifier: GPL-3.0-or-later
"""From a file to names of a marker set that was learned before, by pointer in a real Blender's window; counted.

Then the same where another set fits as well, and the button that answers is pressed.
"""

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

    bpy.ops.mocap_autolabel.clear()
    bpy.context.preferences.addons[stage.EXTENSION].preferences.markerset_folder = stage.TASK["two"]
    bpy.ops.mocap_autolabel.import_take(filepath=stage.TASK["points"])
    yield from window.until(lambda: len(state().likely) and not state().doing)
    seen["asked"] = [one.name for one in state().likely]
    yield from window.screenshot("3-asked")
    places = yield from window.scroll_to(LABEL)  # the uppermost
    yield from window.click(*places[LABEL])
    yield from window.until(lambda: settings().take is not None and not state().doing)
    seen["answered"] = stage.now()[0].names[0][:2]
    yield from window.screenshot("4-answered")


stage.play(walk)
