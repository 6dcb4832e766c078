# SPDX-License-Identifier: GPL-3.0-or-later
"""From a file to names of a marker set that was learned before, by pointer in a real Blender's window; counted.

Then the same where another set fits as well, and the button that answers is pressed.
"""

import time
from collections.abc import Iterator

import bpy
import stage
from stage import settings, state, window


def walk(seen: dict) -> Iterator[float]:
    """What is not counted is what a person has already: the set, in the folder of their own."""
    bpy.context.preferences.addons[stage.EXTENSION].preferences.markerset_folder = stage.TASK["own"]
    yield from window.open_tab("Mocap")
    begun = time.monotonic()
    yield from window.choose("mocap_autolabel.import_take", stage.TASK["points"])  # two: the button, and Open Take
    yield from stage.done(lambda: settings().subjects.found)
    seen["found"] = settings().subjects.found
    yield from window.screenshot("1-found")
    yield from stage.press_button("label")  # the third
    yield from stage.done(lambda: settings().take is not None)
    seen["seconds"] = time.monotonic() - begun
    take, _ = stage.now()
    seen["named"], seen["points"] = int(take.labels.named.sum()), len(take.rows)
    yield from window.screenshot("2-named")

    bpy.ops.mocap_autolabel.clear()
    bpy.context.preferences.addons[stage.EXTENSION].preferences.markerset_folder = stage.TASK["two"]
    bpy.ops.mocap_autolabel.import_take(filepath=stage.TASK["points"])
    yield from stage.done(lambda: len(state().likely))
    seen["asked"] = [one.name for one in state().likely]
    yield from window.screenshot("3-asked")
    yield from stage.press_button("label")  # the uppermost
    yield from stage.done(lambda: settings().take is not None)
    seen["answered"] = stage.now()[0].names[0][:2]
    yield from window.screenshot("4-answered")
