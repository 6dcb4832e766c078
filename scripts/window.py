# SPDX-License-Identifier: GPL-3.0-or-later
"""A hand and an eye inside Blender's window, for tests and screenshots: plays steps, finds buttons, clicks, looks.

Blender needs the option --enable-event-simulate. Coordinates are pixels of the window from its lower left corner.
"""

import importlib
import os
import shutil
import subprocess
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import bpy

WHILE_IT_DRAWS = 0.3
PATIENCE = 200.0  # s; a busy machine draws slowly


def play(steps: Iterator[float]) -> None:
    """Play steps in Blender's window and quit; every step yields the seconds that Blender gets before the next."""

    def turn() -> float | None:
        pause = None
        try:
            with bpy.context.temp_override(window=bpy.context.window_manager.windows[0]):
                pause = next(steps, None)
        finally:
            if pause is None:
                bpy.ops.wm.quit_blender()
        return pause

    bpy.context.preferences.view.show_splash = False
    bpy.app.timers.register(turn, first_interval=2, persistent=True)  # a step may open another file


def until(done: Callable[[], bool], pause: float = 0.2) -> Iterator[float]:
    """Wait until something is so and stays so; TimeoutError where it does not come."""
    end = time.monotonic() + PATIENCE
    while not done():
        if time.monotonic() > end:
            raise TimeoutError(f"waited {PATIENCE:.0f} s in vain")
        yield pause


@contextmanager
def held() -> Iterator[None]:
    """As long as it lasts, no work of the add-on comes to its end, however fast the machine and slow the window."""
    working = importlib.import_module("bl_ext.user_default.mocap_autolabel.addon.ops.long_work").LongWork
    tick, working._tick = working._tick, lambda *_: {"RUNNING_MODAL"}
    try:
        yield
    finally:
        working._tick = tick


def area(kind: str = "VIEW_3D") -> bpy.types.Area:
    """The window's largest area of a kind."""
    areas = [a for a in bpy.context.window_manager.windows[0].screen.areas if a.type == kind]
    return max(areas, key=lambda a: a.width * a.height)


def region(kind: str, inside: str = "VIEW_3D") -> bpy.types.Region:
    """A region ("UI" is the sidebar) of the window's largest area of a kind."""
    return next(r for r in area(inside).regions if r.type == kind)


def open_tab(name: str) -> Iterator[float]:
    """Open the 3D viewport's sidebar at a tab."""
    area().spaces.active.show_region_ui = True
    yield 1
    region("UI").active_panel_category = name
    area().tag_redraw()
    yield 1


def scroll_sidebar(down: bool = True) -> Iterator[float]:
    """Scroll the sidebar to its end, or back to its start."""
    sidebar = region("UI")
    with bpy.context.temp_override(area=area(), region=sidebar):
        scroll = bpy.ops.view2d.scroll_down if down else bpy.ops.view2d.scroll_up
        for _ in range(50):
            scroll()
    sidebar.tag_redraw()
    yield 1


def scroll_to(*names: str) -> Iterator[float]:
    """Scroll the sidebar from its start until the buttons of these operators are seen at once; gives where each is."""
    yield from scroll_sidebar(down=False)
    for _ in range(8):
        found = yield from all_buttons()
        if all(name in found for name in names):
            break
        with bpy.context.temp_override(area=area(), region=region("UI")):
            for _ in range(5):
                bpy.ops.view2d.scroll_down()
        yield 1
    return found


def height() -> Iterator[float]:
    """Gives how high what is in the sidebar is, as a part of the sidebar's height; 1 at least."""
    yield from scroll_sidebar()
    sidebar = region("UI")
    whole = -sidebar.view2d.region_to_view(0, 0)[1] / sidebar.height
    yield from scroll_sidebar(down=False)
    return whole / (-sidebar.view2d.region_to_view(0, 0)[1] / sidebar.height)


def grow(kind: str, pixels: int) -> Iterator[float]:
    """Move the upper edge of the window's largest area of a kind up, or down where `pixels` is less than nothing."""
    shown = area(kind)
    x, y = shown.x + 20, shown.y + shown.height
    point(x, y)  # Blender moves edges while the pointer is in no region
    yield WHILE_IT_DRAWS
    with bpy.context.temp_override(area=shown):
        bpy.ops.screen.area_move("EXEC_DEFAULT", x=x, y=y, delta=pixels)
    yield 1


def choose(operator: str, path: str, picture: str = "") -> Iterator[float]:
    """Press an operator's button and choose a file, or a folder, in the file browser that it opens; a picture of it."""
    places = yield from scroll_to(operator)
    yield from click(*places[operator])
    yield from browse(path, picture)


def browse(path: str, picture: str = "") -> Iterator[float]:
    """Choose a file, or a folder, in the file browser that is being opened."""
    yield from until(lambda: _browser() is not None)
    shown, browser = _browser()
    folder, name = (Path(path), "") if Path(path).is_dir() else (Path(path).parent, Path(path).name)
    browser.spaces.active.params.directory, browser.spaces.active.params.filename = str(folder).encode(), name
    yield 1
    if picture:
        yield from screenshot(picture)
    with bpy.context.temp_override(window=shown, area=browser):
        bpy.ops.file.execute()
    yield 0.2


def _browser() -> tuple[bpy.types.Window, bpy.types.Area] | None:
    shown = [(one, a) for one in bpy.context.window_manager.windows for a in one.screen.areas]
    return next(((one, a) for one, a in shown if a.type == "FILE_BROWSER" and a.spaces.active.params), None)


def look_through_first() -> Iterator[float]:
    """Look through the scene's first calibrated camera, filling the view."""
    context = {"area": area(), "region": region("WINDOW")}
    camera = next(
        item for item in bpy.context.scene.mocap_autolabel.source.cameras.all_objects if item.type == "CAMERA"
    )
    with bpy.context.temp_override(**context):
        bpy.ops.mocap_autolabel.look_through(camera=camera.name)
    area().spaces.active.region_3d.view_perspective = "CAMERA"
    yield 1
    with bpy.context.temp_override(**context):
        bpy.ops.view3d.view_center_camera()
    yield 1


def show_all() -> None:
    """Let the 3D view show everything there is."""
    with bpy.context.temp_override(area=area(), region=region("WINDOW")):
        bpy.ops.view3d.view_all()


def screenshot(name: str) -> Iterator[float]:
    """Save a picture of the whole window, as a user sees it, to NAME.png in the folder MOCAP_OUT."""
    for _ in range(3):  # panels grow over several redraws
        for shown in bpy.context.window_manager.windows[0].screen.areas:
            shown.tag_redraw()
        yield 0.7
    path = str(Path(os.environ["MOCAP_OUT"], name + ".png"))
    if os.environ.get("DISPLAY") and shutil.which("import"):
        subprocess.run(["import", "-window", "root", "-colors", "256", "PNG8:" + path], check=True)
    else:
        bpy.ops.screen.screenshot(filepath=path)


def point(x: int, y: int) -> None:
    """Move the pointer."""
    _event("MOUSEMOVE", "NOTHING", x, y)


def click(x: int, y: int, **modifiers: bool) -> Iterator[float]:
    """Click with the left button, as a hand would: move, press, release; `shift=True` and the like are held."""
    for kind, value in (("MOUSEMOVE", "NOTHING"), ("LEFTMOUSE", "PRESS"), ("LEFTMOUSE", "RELEASE")):
        _event(kind, value, x, y, **modifiers)
        yield WHILE_IT_DRAWS


def drag(begin: tuple[int, int], end: tuple[int, int], stop: str = "", button: str = "LEFTMOUSE") -> Iterator[float]:
    """Drag with a button from a place to another; the key `stop` is pressed before the button is let go."""
    middle = (begin[0] + end[0]) // 2, (begin[1] + end[1]) // 2
    _event("MOUSEMOVE", "NOTHING", *begin)
    yield WHILE_IT_DRAWS
    _event(button, "PRESS", *begin)
    for place in (middle, end):
        yield WHILE_IT_DRAWS
        _event("MOUSEMOVE", "NOTHING", *place)
    yield WHILE_IT_DRAWS
    if stop:
        yield from press(stop, *end)
    _event(button, "RELEASE", *end)
    yield WHILE_IT_DRAWS


def press(key: str, x: int, y: int) -> Iterator[float]:
    """Press and release a key with the pointer at a place."""
    for value in ("PRESS", "RELEASE"):
        _event(key, value, x, y)
        yield WHILE_IT_DRAWS


def tap(key: str, x: int, y: int) -> Iterator[float]:
    """Press a key and let it go at once, with the pointer at a place: a pie stays open only so."""
    for value in ("PRESS", "RELEASE"):
        _event(key, value, x, y)
    yield WHILE_IT_DRAWS


def turn_wheel(way: str, x: int, y: int, **modifiers: bool) -> Iterator[float]:
    """Turn the wheel by a notch, `way` WHEELUPMOUSE or WHEELDOWNMOUSE, with the pointer at a place."""
    point(x - 1, y)
    yield WHILE_IT_DRAWS
    point(x, y)
    yield WHILE_IT_DRAWS
    _event(way, "PRESS", x, y, **modifiers)
    yield WHILE_IT_DRAWS


def buttons(found: dict[str, tuple[int, int]], step: int = 9, until: str = "", top: float = 1.0) -> Iterator[float]:
    """Find the sidebar's operator buttons by pointing down along it; `found` gets operator name -> place.

    It begins at the part `top` of the sidebar's height, and ends with the button of the operator `until`.
    """
    sidebar = region("UI")
    x = sidebar.x + sidebar.width // 2 - 20
    point(sidebar.x - 40, sidebar.y + sidebar.height // 2)  # off the sidebar, where a button may be lit up still
    yield WHILE_IT_DRAWS
    for y in range(sidebar.y + int(top * sidebar.height) - 5, sidebar.y + 5, -step):
        point(x, y)
        yield 0.05
        with bpy.context.temp_override(area=area(), region=sidebar):
            if not bpy.ops.ui.copy_python_command_button.poll():
                continue
            bpy.context.window_manager.clipboard = ""
            bpy.ops.ui.copy_python_command_button()
        command = bpy.context.window_manager.clipboard
        if command.startswith("bpy.ops."):
            found.setdefault(command.removeprefix("bpy.ops.").partition("(")[0], (x, y))
            if until in found:
                return


def all_buttons() -> Iterator[float]:
    """Find the sidebar's operator buttons; gives operator name -> place."""
    found: dict[str, tuple[int, int]] = {}
    yield from buttons(found)
    return found


def _event(kind: str, value: str, x: int, y: int, **modifiers: bool) -> None:
    shown = bpy.context.window_manager.windows[0]
    shown.event_simulate(type=kind, value=value, x=int(x), y=int(y), **modifiers)
