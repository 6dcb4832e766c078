# SPDX-License-Identifier: GPL-3.0-or-later
"""What all tests share: a Blender without the user's settings, repeatable random cases, and what is at hand."""

import atexit
import importlib.util
import os
import sys
import tempfile
from pathlib import Path

import pytest
from hypothesis import settings

# Blender reads this when it is first imported: tests neither see nor change what the user has set up.
_resources = tempfile.TemporaryDirectory(prefix="mocap-tests-")
os.environ["BLENDER_USER_RESOURCES"] = _resources.name

settings.register_profile("repeatable", derandomize=True, deadline=None, print_blob=True)
settings.load_profile("repeatable")

EXIT_STATUS = pytest.StashKey[int]()
SHARED_DATA = Path(__file__).resolve().parents[2] / "shared" / "data"
# Files and folders that `run.py test --quick` leaves out: each takes 10 s of the processor or more. All others
# together take 375 s of it, which is under four minutes on two cores.
SLOW = (
    "blender/test_quality.py",
    "cli/test_batches.py", "cli/test_farm.py", "cli/test_force.py", "cli/test_train.py",
    "io/test_fuzz.py", "package/",
)  # fmt: skip


@pytest.fixture(scope="session")
def shared_data() -> Path:
    """The folder of recorded people and rooms beside the repository; skips the test when it is not there."""
    if not SHARED_DATA.is_dir():
        pytest.skip("the recorded people and rooms (../shared/data) are not on this machine")
    return SHARED_DATA


def pytest_collection_modifyitems(items):
    """Marks what is slow, so that `-m "not slow"` leaves it out, and skips what needs Blender where there is none."""
    for item in items:
        if item.get_closest_marker("blender") and not importlib.util.find_spec("bpy"):
            item.add_marker(pytest.mark.skip(reason="needs bpy"))
        if item.path.relative_to(Path(__file__).parent).as_posix().startswith(SLOW):
            item.add_marker("slow")


@pytest.hookimpl(trylast=True)
def pytest_sessionfinish(session):
    session.config.stash[EXIT_STATUS] = int(session.exitstatus)


@pytest.hookimpl(trylast=True)
def pytest_unconfigure(config):
    """Ends the process by force where Blender 4.5 is in it, which may wait for ever for itself when Python ends."""
    bpy = sys.modules.get("bpy")
    if bpy is None or bpy.app.version >= (5, 0):
        return
    atexit._run_exitfuncs()
    sys.stdout.flush()
    sys.stderr.flush()
    os._exit(config.stash.get(EXIT_STATUS, 1))


def pytest_report_header(config) -> str:
    bpy = "with" if importlib.util.find_spec("bpy") else "without"
    data = "with" if SHARED_DATA.is_dir() else "without"
    return f"{bpy} the bpy module, {data} recorded people and rooms"
