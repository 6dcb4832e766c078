# SPDX-License-Identifier: GPL-3.0-or-later
"""What a plain `label` must not load: whoever labels a short take waits for it every time."""

import json
import subprocess
import sys

import pytest

from addon.demo.take import MODEL

# Of SciPy, NumPy's testing and what others bring, half a second; of ours, what other takes, verbs and options need.
HEAVY = ("scipy", "unittest", "xml", "numpy.testing", "numpy.f2py", "concurrent", "multiprocessing", "asyncio", "bpy")
OTHERS = (
    "addon.cli.label.farm", "addon.cli.workers", "addon.io.html",
    "addon.core.filling", "addon.core.placement_quality", "addon.core.papers.partial_solvers.solver",
    "addon.core.points.whole_take.recognition", "addon.core.simulation", "addon.core.training",
)  # fmt: skip
OF_BLOBS = ("addon.core.blobs", "addon.core.reconstruction", "addon.io.toml_cameras", "addon.io.xml_cameras")
CODE = (
    "import json, sys; from addon.cli import main; status = main(sys.argv[1:]); "
    "print(json.dumps(sorted(sys.modules)), file=sys.stderr); sys.exit(status)"
)


@pytest.mark.parametrize(("kind", "unneeded"), [("points", HEAVY + OTHERS + OF_BLOBS), ("blobs", HEAVY + OTHERS)])
def test_labelling_loads_nothing_that_it_does_not_need(room, tmp_path, kind, unneeded):
    given = [room.c3d] if kind == "points" else [room.blobs, "--cameras", room.cameras, "--frames", "100:103"]
    line = ["label", *given, "--model", MODEL, "--out", tmp_path / "out"]
    done = subprocess.run([sys.executable, "-c", CODE, *map(str, line)], capture_output=True, text=True, check=True)
    loaded = json.loads(done.stderr.splitlines()[-1])
    assert "addon.core.points.models" in loaded
    assert [name for name in loaded if any(name == one or name.startswith(one + ".") for one in unneeded)] == []


def test_listing_the_models_loads_nothing_that_names_markers():
    line = [sys.executable, "-c", CODE, "models"]
    loaded = json.loads(subprocess.run(line, capture_output=True, text=True, check=True).stderr.splitlines()[-1])
    assert [name for name in loaded if name.startswith(("scipy", "addon.core.points", "addon.core.blobs"))] == []
