# SPDX-License-Identifier: GPL-3.0-or-later
"""A hand that takes one take from raw to clean in a real Blender's window, and counts what it does.

Runs as the window's script. Its task is the JSON file `by_hand.json` in the folder MOCAP_OUT: the zip, the take and the
model. It goes by the list To Look at, from the worst on, as a person would who looks once at each and presses what the
list offers where what is seen agrees. What was done goes to `hand.json`, the files of the take beside it.
"""

import importlib
import json
import os
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import bpy
import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "scripts"))

import window

OUT = Path(os.environ["MOCAP_OUT"])
ADDON = "bl_ext.user_default.mocap_autolabel.addon"
NEXT, MEND, ACCEPT = (f"mocap_autolabel.{name}" for name in ("next_trouble", "mend_trouble", "accept_trouble"))
LABEL, EXPORT = "mocap_autolabel.label", "mocap_autolabel.export_c3d"
PATIENCE = 400.0  # s for labelling and filling
ANSWERING = 15.0  # s for anything else
POLL, SLOWLY = 0.02, 0.5  # s between two looks whether Blender is done, with a click and with long work
BESIDE = 0.04  # m from where a marker should be to a point that a person takes for it; a plate's are farther apart
STOP = 0.01  # of the frames: what has less at stake is left open
LIST_BELOW = 0.65  # of the sidebar's height: above it is the list, not its buttons
MOST = 45  # troubles that are looked at
STEPS: list[dict] = []


def walk() -> Iterator[float]:
    """Import, label, go through the list, fill, export."""
    task = json.loads((OUT / "by_hand.json").read_text())
    bpy.ops.extensions.package_install_files(filepath=task["zip"], repo="user_default", enable_on_install=True)
    bpy.data.batch_remove(list(bpy.data.objects))
    yield from window.open_tab("Mocap")
    with did("raw file", "Import 3D Points, the file, OK", clicks=3):
        bpy.ops.mocap_autolabel.import_points(filepath=task["points"])
    with did("marker set", "the folder, the file, OK", clicks=3):
        bpy.ops.mocap_autolabel.open_markerset(filepath=task["model"])
    bpy.ops.ed.undo_push(message="Imported")
    yield 1
    yield from window.screenshot("by-hand-raw")
    places: dict = {}
    yield from window.buttons(places)
    yield from click(places[LABEL], "not labelled", "Label", lambda: bool(settings().take) and not review().doing)
    yield from until(lambda: len(review().troubles), ANSWERING)
    yield 2
    counts = [still_open()]
    export("before")
    with bpy.context.temp_override(area=window.area(), region=window.region("WINDOW")):
        bpy.ops.wm.tool_set_by_id(name="mocap_autolabel.label_tool")
    STEPS.append(
        {
            "what": "labelled",
            "done": "the tool Label; down to the list",
            "clicks": 1,
            "keys": 1,
            "looks": 0,
            "machine": 0.0,
        }
    )
    yield from scroll_to_list()
    yield from through_the_list()
    yield from window.screenshot("by-hand-clean")
    counts.append(still_open())
    with did("clean", "Export C3D, Enter", clicks=1, keys=1):
        export("after")
    said = {"steps": STEPS, "open": counts, "left": [row.reason for row in review().troubles if not row.answered]}
    (OUT / "hand.json").write_text(json.dumps(said, indent=1))


def through_the_list() -> Iterator[float]:
    """From the worst on: J goes there; then what is offered is done, or it is right."""
    filled = pictured = False
    for turn in range(MOST):
        step = {"clicks": 0, "keys": 1, "looks": 1, "machine": 0.0}
        was, began = review().trouble_shown, time.monotonic()
        middle = window.region("WINDOW")
        yield from window.press("J", middle.x + middle.width // 3, middle.y + middle.height // 3)
        yield from until(lambda: review().trouble_shown != was, 2.0)  # noqa: B023 - it is waited for here
        step["machine"] += time.monotonic() - began - window.WHILE_IT_DRAWS * 2
        found = troubles()
        trouble = found[review().trouble_index]
        if trouble.answered or trouble.stake < STOP * len(stored().motion.frames):
            return
        if turn == 1:
            yield from window.screenshot("by-hand-trouble")
        button, words = decide(trouble, filled)
        if button == MEND and trouble.action == "fill":
            filled = True
        if not button:
            STEPS.append({"what": trouble.reason, "done": words} | step)
            continue
        places: dict = {}
        yield from find(button, places)
        if button not in places:
            button, words = ACCEPT, trouble.answer
            yield from find(button, places)
        said = json.dumps([len(stored().edits), len(stored().fills)])
        began = time.monotonic()
        yield from press_button(places[button])
        patience = PATIENCE if filled else ANSWERING
        yield from until(lambda: json.dumps([len(stored().edits), len(stored().fills)]) != said, patience)  # noqa: B023
        yield from until(lambda: len(review().troubles) and not review().doing, ANSWERING)
        step["machine"] += time.monotonic() - began - window.WHILE_IT_DRAWS
        step["clicks"] += 1
        STEPS.append({"what": trouble.reason, "done": words} | step)
        if filled and not pictured:
            pictured = True
            yield from window.screenshot("by-hand-filled")
        (OUT / "steps.json").write_text(json.dumps(STEPS, indent=1))
        yield 0.5


def decide(trouble, filled: bool) -> tuple[str, str]:
    """Which of the two buttons a person presses who sees what is where, and what it says."""
    reviewing = importlib.import_module(f"{ADDON}.ops.reviewing")
    offered, answer = reviewing.words_for(trouble), trouble.answer
    if trouble.action == "name" and offered:
        return (MEND, offered) if is_beside(trouble) else (ACCEPT, answer)
    if trouble.action == "fill" and not filled:
        return MEND, offered
    if trouble.kind == "off the body":  # where nothing was measured nobody can see that it is right
        return "", "left open"
    return ACCEPT, answer


def is_beside(trouble) -> bool:
    """What the eye sees: whether the point that has no name is where the marker should be."""
    take = stored()
    rows = take.rows
    numbers = take.motion.frames[rows.frame]
    inside = (rows.trajectory == trouble.trajectories[0]) & (numbers >= trouble.first) & (numbers <= trouble.last)
    inside &= take.labels.marker < 0
    should = take.motion.expected[rows.frame[inside], take.names.index(trouble.markers[0])]
    off = np.linalg.norm(rows.xyz[inside] - should, axis=1)
    return bool(np.isfinite(off).any() and np.nanmedian(off) < BESIDE)


class did:  # noqa: N801 - reads as what it says
    """Notes a step that the script does without a pointer, as in a file browser: clicks and keys a person needs."""

    def __init__(self, what: str, done: str, clicks: int = 0, keys: int = 0):
        self.step = {"what": what, "done": done, "clicks": clicks, "keys": keys, "looks": 0}

    def __enter__(self):
        self.began = time.monotonic()

    def __exit__(self, *_):
        STEPS.append(self.step | {"machine": time.monotonic() - self.began})


def click(place, what: str, done: str, finished: Callable[[], bool]) -> Iterator[float]:
    """A click whose work is waited for."""
    began = time.monotonic()
    yield from press_button(place)
    yield from until(finished, PATIENCE)
    machine = time.monotonic() - began - window.WHILE_IT_DRAWS
    STEPS.append({"what": what, "done": done, "clicks": 1, "keys": 0, "looks": 0, "machine": machine})


def press_button(place) -> Iterator[float]:
    """Press a button, and let Blender see to it."""
    shown = bpy.context.window_manager.windows[0]
    for kind, value in (("MOUSEMOVE", "NOTHING"), ("LEFTMOUSE", "PRESS"), ("LEFTMOUSE", "RELEASE")):
        shown.event_simulate(type=kind, value=value, x=place[0], y=place[1])
        yield window.WHILE_IT_DRAWS / 3


def scroll_to_list() -> Iterator[float]:
    """Scroll the sidebar until the list's Next is in its upper half."""
    yield from window.scroll_sidebar()
    for _ in range(8):
        places: dict = {}
        yield from window.buttons(places, step=14)
        if NEXT in places:
            sidebar = window.region("UI")
            with bpy.context.temp_override(area=window.area(), region=sidebar):
                bpy.ops.view2d.pan(deltax=0, deltay=places[NEXT][1] - sidebar.y - int(0.6 * sidebar.height))
            yield 1
            return
        with bpy.context.temp_override(area=window.area(), region=window.region("UI")):
            bpy.ops.view2d.pan(deltax=0, deltay=500)
        yield 1


def find(button: str, places: dict) -> Iterator[float]:
    """Where a button of the list is; `places` gets it."""
    for _ in range(2):
        yield from window.buttons(places, until=button, top=LIST_BELOW)
        if button in places:
            return
        yield from scroll_to_list()


def until(done: Callable[[], bool], patience: float) -> Iterator[float]:
    """Wait for something, though not for ever."""
    limit = time.monotonic() + patience
    while not done() and time.monotonic() < limit:
        yield POLL if patience < PATIENCE else SLOWLY


def export(name: str) -> None:
    """The labels and the markers as they are now."""
    bpy.ops.mocap_autolabel.export_labels(filepath=str(OUT / f"{name}.labels.csv"))
    bpy.ops.mocap_autolabel.export_c3d(filepath=str(OUT / f"{name}.c3d"))


def still_open() -> int:
    return sum(not row.answered for row in review().troubles)


def settings() -> bpy.types.PropertyGroup:
    return bpy.context.scene.mocap_autolabel


def review() -> bpy.types.PropertyGroup:
    return bpy.context.window_manager.mocap_autolabel


def stored():
    """The take as it is with all corrections and fills."""
    return importlib.import_module(f"{ADDON}.scene.opened").opened.take(settings().take, bpy.context.scene)


def troubles():
    return importlib.import_module(f"{ADDON}.scene.trouble").trouble_of(settings().take, bpy.context.scene)


window.play(walk())
