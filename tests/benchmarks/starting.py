# SPDX-License-Identifier: GPL-3.0-or-later
"""What `label` takes beyond naming, from the shell to its files, and short takes side by side, as a Markdown table.

python -m tests.benchmarks.starting

Each command runs in a process of its own, as a shell starts it; medians, by NumPy and by the compiled library. Naming
is what reports say that it took, added up over takes.
"""

import json
import os
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from statistics import median

from addon.core.kernels.library import SWITCH
from addon.demo.take import MODEL
from scripts.results import markdown
from scripts.virtual_take import write_virtual_points, write_virtual_take

TAKES, FRAMES = 36, 200
COMMAND = (sys.executable, "-c", "import sys; from addon.cli import main; sys.exit(main())", "label", "--model", MODEL)
NAMING = ("place", "fit", "label")  # of a report's timing
REPEATS = 9  # of each command


def jobs(folder: Path) -> Iterator[tuple[str, list[str]]]:
    """What is labelled, and the arguments."""
    write_virtual_take(folder, FRAMES)
    write_virtual_points(folder, FRAMES)
    yield f"blobs, {FRAMES} frames", [str(folder / "take.csv"), "--cameras", str(folder / "cameras.toml")]
    yield f"points, {FRAMES} frames", [str(folder / "walk.c3d")]
    takes = [str(shutil.copy(folder / "walk.c3d", folder / f"{number:02}.c3d")) for number in range(TAKES)]
    for side_by_side in ("1", "2"):
        what = f"{TAKES} takes of points, {FRAMES} frames each, `--jobs {side_by_side}`"
        yield what, [*takes, "--jobs", side_by_side]


def seconds(words: list[str], out: Path, numpy: bool) -> tuple[float, float, float]:
    """Wall and processor time of a command and all that it starts, into a folder that is not there, and naming's."""
    shutil.rmtree(out, ignore_errors=True)
    begin, before = time.perf_counter(), os.times()
    way = os.environ | {SWITCH: str(int(numpy))}
    subprocess.run([*COMMAND, *words, "--out", str(out)], check=True, stdout=subprocess.DEVNULL, env=way)
    after, wall = os.times(), time.perf_counter() - begin
    core = after.children_user + after.children_system - before.children_user - before.children_system
    timings = [json.loads(report.read_text(encoding="utf-8"))["timing"] for report in out.glob("*.report.json")]
    return wall, core, sum(timing[stage] for timing in timings for stage in NAMING)


def main() -> int:
    """Measures both ways."""
    rows = []
    with tempfile.TemporaryDirectory() as made:
        folder = Path(made)
        for what, words in jobs(folder):
            for way in ("NumPy", "compiled"):
                seen = [seconds(words, folder / "out", way == "NumPy") for _ in range(REPEATS)]
                rows.append([what, way, *(f"{median(times):.2f}" for times in zip(*seen, strict=True))])
    columns = ["`label`", "by", "seconds of wall", "of the processor", "naming, of wall"]
    print(f"{os.cpu_count()} cores\n\n{markdown(columns, rows)}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
