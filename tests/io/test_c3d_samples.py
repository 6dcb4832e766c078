# SPDX-License-Identifier: GPL-3.0-or-later
"""Files of many makers, read as ezc3d reads them or, where the two differ, with the reason.

They are not part of the project: the test looks for clones of biomechanics-foundation/c3dio and pyomeca/ezc3d-testFiles
(any folder with their C3D files in it) where C3D_SAMPLES points, or beside the repository in `c3d-samples`.
"""

import hashlib
import os
import re
import warnings
from pathlib import Path

import numpy as np
import pytest

from addon.core.data.errors import InputError
from addon.io.c3d.layout import find_layout
from addon.io.c3d.parameters import C3dFile
from tests.io.whole_columns import read_c3d

ezc3d = pytest.importorskip("ezc3d")

FOLDER = Path(os.environ.get("C3D_SAMPLES", Path(__file__).resolve().parents[3] / "c3d-samples"))

REFUSED = {  # without a single point there is nothing to name
    "EMG Data Cometa.c3d": "has no points",
    "emgwl.c3d": "has no points",
    "Mega Electronics Isokinetic EMG Angle Torque Sample File.c3d": "has no points",
    "C3DRotationExample.c3d": "has no points",
    "Kistler.c3d": "has no points",
    "simple.c3d": "is of an unknown processor (0)",  # a header and nothing else
}
UNREAD = {  # by ezc3d: MIPS, or details of the parameters that it does not forgive
    "Eb015si.c3d", "Eb015sr.c3d", "sgi_int.c3d", "sgi_real.c3d", "MACsample.c3d", "Dance.c3d", "golfswing.c3d",
    "bad_parameter_section.c3d", "BKINtechnologies.c3d", "Facial-Sing.c3d", "short-copy.c3d", "phasespace_sample.c3d",
}  # fmt: skip
TORN = {  # ezc3d counts other analog words or points in a frame, so that its points jump from frame to frame
    "evart.c3d", "kyowadengyo.c3d", "dynamic.C3D", "standing.C3D", "type1.C3D",
}  # fmt: skip
SAID = {  # the files that contradict themselves, and how
    "Dance.c3d": "499 fill it", "Dance1.c3d": "498 fill it", "golfswing.c3d": "514 fill it",
    "golfswing1.c3d": "513 fill it",
    "MotionMonitorC3D.c3d": "16 words of analog data, but 112 fill the file",
    "Optotrak.c3d": "1149 frames, but ends with the end of frame 29",
}  # fmt: skip


def samples() -> list[Path]:
    """Every file once, without those that are kept elsewhere."""
    found = {}
    for path in sorted(FOLDER.rglob("*")):
        if path.suffix.lower() == ".c3d" and not path.read_bytes()[:20].startswith(b"version https://git"):
            found.setdefault(hashlib.md5(path.read_bytes()).hexdigest(), path)
    return sorted(found.values())


def _id(path: Path) -> str:
    return "-".join(path.parts[-2:]).replace(" ", "_")


SAMPLES = samples() if FOLDER.is_dir() else []


NONE = pytest.mark.skip(reason=f"no C3D samples of makers: neither {FOLDER.name} beside the project nor C3D_SAMPLES")


@pytest.mark.parametrize("path", SAMPLES or [pytest.param(Path(), marks=NONE)], ids=_id)
def test_a_sample_is_read_as_ezc3d_reads_it(path):
    if path.name in REFUSED:
        with pytest.raises(InputError, match=re.escape(REFUSED[path.name])):
            read_c3d(path)
        return
    take = read_c3d(path)
    assert [SAID[path.name] in note for note in take.notes] == [True] if path.name in SAID else not take.notes
    # Whatever the layout, people do not jump by a metre from one frame to the next.
    assert not np.nanpercentile(_steps(take.xyz), 95, axis=None) > 0.6 * _size(take.xyz)
    if path.name in UNREAD:
        return
    theirs = ezc3d.c3d(str(path))
    points = theirs["data"]["points"][:3].transpose(2, 1, 0).copy()
    residual = theirs["data"]["meta_points"]["residuals"][0].T
    missing = (residual < 0) | ~np.isfinite(points).all(axis=2) | (points == 0).all(axis=2)
    points[missing] = np.nan
    if path.name in TORN:
        assert np.nanpercentile(_steps(points), 95) > 10 * np.nanpercentile(_steps(take.xyz), 95)
        return
    np.testing.assert_array_equal(points, take.xyz)
    assert take.rate == pytest.approx(theirs["header"]["points"]["frame_rate"])
    _differ_by_the_bytes(path, take.residual, residual)


def _differ_by_the_bytes(path: Path, ours: np.ndarray, theirs: np.ndarray):
    """The low byte of the fourth word, times the scale, is the residual, says the guide; ezc3d takes the high one."""
    file = C3dFile(path.read_bytes(), path)
    layout = find_layout(file)
    content = file.content[layout.start : layout.start + layout.frames * layout.stride * file.width]
    words = file.reals(content) if file.scale < 0 else np.frombuffer(content, file.order + "i2")
    words = words.reshape(layout.frames, -1)[:, 3 : 4 * layout.points : 4]
    there = np.isfinite(ours)
    word = words[there].astype(int)
    np.testing.assert_allclose(ours[there], (word & 0xFF) * abs(file.scale), rtol=1e-6)
    np.testing.assert_allclose(theirs[there], (word >> 8) * abs(file.scale), rtol=1e-6)


def _steps(xyz: np.ndarray) -> np.ndarray:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)
        steps = np.linalg.norm(np.diff(xyz, axis=0), axis=2)
    return steps if np.isfinite(steps).any() else np.zeros((1, 1))


def _size(xyz: np.ndarray) -> float:
    """How far the points reach, in the file's units."""
    if not np.isfinite(xyz).any():
        return 1.0
    return float(np.max(np.nanpercentile(xyz, 98, axis=(0, 1)) - np.nanpercentile(xyz, 2, axis=(0, 1))))
