# SPDX-License-Identifier: GPL-3.0-or-later
"""Memory of long takes of blobs: python -m tests.benchmarks.long_blobs [--frames 432000] [--blend].

What eight cameras see of the demo's virtual person goes back the way it came, and so on, until the take is as long as
asked; it is labelled from file to files. Memory is flat where a take that is ten times as long peaks no higher but by
what its poses and points themselves are. With --blend a Blender file is saved as
well, and opened, played and saved again by another process. Linux only.
"""

import argparse
import json
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from time import process_time

import numpy as np

from addon import capturing
from addon.core.data.takes import Blobs
from addon.core.geometry.cameras import Cameras
from addon.demo.take import MODEL, TROUBLE, make_performance
from addon.io.blobs import BlobWriter, read_blobs
from addon.io.cameras import write_cameras
from addon.io.markersets import open_markerset
from addon.jobs import LabelJob, label_file

from .memory import forget_peak, megabytes

RATE = 120.0


def write_take(folder: Path, frames: int) -> int:
    """Writes take.csv and cameras.toml, and gives how many blobs the take has."""
    made = make_performance(open_markerset(MODEL))
    for _ in capturing.write_capture(made.take, made.cameras, TROUBLE, made.body, folder / "once.csv"):
        pass
    write_cameras(folder / "cameras.toml", made.cameras)
    once = Blobs.join(rows.blobs for rows in read_blobs(folder / "once.csv", made.cameras))
    return write_there_and_back(folder / "take.csv", once, made.cameras, frames)


def write_there_and_back(path: Path, once: Blobs, cameras: Cameras, frames: int) -> int:
    """Writes blobs forwards and backwards by turns until there are so many frames; gives how many blobs there are."""
    count, first, blobs = len(once.frames), 1, 0
    with BlobWriter(path, cameras) as writer:
        for part in there_and_back(once):
            if first > frames:
                break
            kept = part.frame < frames + 1 - first
            part = Blobs(
                first + np.arange(count), *(getattr(part, name)[kept] for name in ("frame", "camera", "xy", "area"))
            )
            writer.write(part)
            first, blobs = first + count, blobs + len(part)
    return blobs


def there_and_back(once: Blobs) -> Iterator[Blobs]:
    """The blobs forwards, backwards, forwards, without end."""
    order = np.argsort(-once.frame, kind="stable")
    back = replace(
        once,
        frame=(len(once.frames) - 1 - once.frame)[order],
        **{name: getattr(once, name)[order] for name in ("camera", "xy", "area")},
    )
    while True:
        yield once
        yield back


def measure(folder: Path, blend: bool):
    """Labels the take, and prints the peak beyond what the program takes itself."""
    begin, before = process_time(), megabytes("VmRSS")
    forget_peak()
    job = LabelJob(folder / "take.csv", folder / "cameras.toml", MODEL, out=folder / "out", rate=RATE, blend=blend)
    for step in label_file(job):
        last = step
    peak = megabytes("VmHWM")
    report = json.loads(next((folder / "out").glob("*.report.json")).read_text(encoding="utf-8"))
    print(f"{last.note}: {peak - before:.0f} MB beyond {before:.0f}, {process_time() - begin:.0f} s of the processor")
    print({name: report[name] for name in report if name in ("blobs", "unlabelled", "frames")})


OPENING = """
import bpy, sys
from time import perf_counter, process_time
from tests.benchmarks.memory import megabytes
before, begin = megabytes("VmRSS"), perf_counter()
bpy.ops.wm.open_mainfile(filepath=sys.argv[1])
print(f"opened: {megabytes('VmHWM') - before:.0f} MB beyond {before:.0f}, {perf_counter() - begin:.1f} s", flush=True)
scene = bpy.context.scene
middle = (scene.frame_start + scene.frame_end) // 2
scene.frame_set(middle)
begin = process_time()
for frame in range(middle, middle + 300):
    scene.frame_set(frame)
print(f"played: {300 / (process_time() - begin):.0f} frames a second of the processor", flush=True)
begin = perf_counter()
bpy.ops.wm.save_as_mainfile(filepath=sys.argv[1])
print(f"saved: {megabytes('VmHWM') - before:.0f} MB beyond {before:.0f}, {perf_counter() - begin:.1f} s", flush=True)
"""


def open_saved(path: Path):
    """Opens a Blender file and saves it again, in a process of its own, and prints the peak."""
    motion = path.with_suffix(".motion.pc2")
    beside = f", {motion.stat().st_size / 1e6:.0f} MB of motion beside it" if motion.exists() else ""
    print(f"{path.stat().st_size / 1e6:.2f} MB of Blender file{beside}", flush=True)
    subprocess.run([sys.executable, "-c", OPENING, str(path)], check=True)


def main():
    """Prints what the labelling of a long take holds in memory."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--frames", type=int, default=432_000)
    parser.add_argument("--blend", action="store_true", help="save a Blender file as well, and open it")
    given = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        blobs = write_take(folder, given.frames)
        print(f"{given.frames} frames, {blobs} blobs, {(folder / 'take.csv').stat().st_size / 1e6:.0f} MB", flush=True)
        measure(folder, given.blend)
        if given.blend:
            open_saved(folder / "out" / "take.blend")


if __name__ == "__main__":
    main()
