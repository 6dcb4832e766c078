# SPDX-License-Identifier: GPL-3.0-or-later
"""A ray constrains a fill across it and not along it, smoothly, and is not believed where it is another marker's."""

import numpy as np
import pytest

from addon.core.data.takes import NO_MARKER, Blobs, Labels
from addon.core.filling.gaps import Gap
from addon.core.filling.rays import RAY_LIMITS, MarkerRays, constrained, rays_of
from addon.core.simulation.rigs import ring_rig

FRAMES, RATE = 200, 100.0
CAMERAS = ring_rig(4)
GAP = Gap(60, 120, 0)


def path() -> np.ndarray:
    """(T, 3) m, where a marker goes."""
    time = np.arange(FRAMES) / RATE
    return np.column_stack([0.3 * np.sin(2 * time), 0.2 * time, 1 + 0.1 * np.cos(3 * time)])


def seen_by(camera: int, xyz: np.ndarray, frames: np.ndarray, marker: int = 0) -> tuple[Blobs, Labels]:
    """One blob of a marker in some frames of a take, in one camera."""
    pixels = CAMERAS.project(xyz[frames])[camera]
    count = len(frames)
    blobs = Blobs(np.arange(1, FRAMES + 1), frames, np.full(count, camera), pixels, np.full(count, np.nan))
    return blobs, Labels(np.full(count, marker), np.ones(count, int), np.ones(count))


@pytest.fixture
def rays():
    missing = np.zeros((FRAMES, 2), bool)
    missing[GAP.start : GAP.stop, 0] = True
    return rays_of(*seen_by(1, path(), GAP.frames), CAMERAS, missing)


def off_by(size: float = 0.01) -> np.ndarray:
    """(L, 3) m, a fill that is off by an error that comes and goes."""
    bump = np.sin(np.linspace(0, np.pi, len(GAP) + 2))[1:-1]
    return path()[GAP.start : GAP.stop] + size * bump[:, None] * [1.0, -0.5, 0.7]


def parts(fill: np.ndarray, rays: MarkerRays) -> tuple[np.ndarray, np.ndarray]:
    """m, how far a fill is off along the rays and across them."""
    off = fill[rays.frame - GAP.start] - path()[rays.frame]
    along = np.einsum("ki,ki->k", off, rays.direction)
    return np.abs(along), np.linalg.norm(off - along[:, None] * rays.direction, axis=1)


def own() -> np.ndarray:
    there = np.ones(FRAMES, bool)
    there[GAP.start : GAP.stop] = False
    return there


def test_a_fill_lies_on_the_rays_and_is_as_deep_as_before(rays):
    before = off_by()
    after, expected, count = constrained(before, GAP, 0.01, rays, own(), RATE)
    assert count == len(GAP) == len(rays)
    (deep, aside), (still_deep, left) = parts(before, rays), parts(after, rays)
    assert left.max() < 0.1 * aside.max()
    np.testing.assert_allclose(still_deep, deep, atol=0.15 * deep.max())
    assert 0.003 < expected < 0.01
    whole = np.concatenate([path()[[GAP.start - 1]], after, path()[[GAP.stop]]])
    jerk = np.linalg.norm(np.diff(whole, 2, axis=0), axis=1)
    assert jerk.max() < 0.001, "it meets its ends"


def test_rays_of_some_frames_draw_their_neighbours_along_and_one_far_off_is_another_markers(rays):
    some = MarkerRays(*(getattr(rays, name)[20:40] for name in ("marker", "frame", "origin", "direction", "spread")))
    after, _, count = constrained(off_by(), GAP, 0.01, some, own(), RATE)
    assert count == 20
    steps = np.linalg.norm(np.diff(after - off_by(), axis=0), axis=1)
    assert steps.max() < 0.003
    assert parts(after, some)[1].max() < 0.002
    np.testing.assert_allclose(after[0], off_by()[0], atol=0.002)
    missing = np.zeros((FRAMES, 2), bool)
    missing[GAP.start : GAP.stop, 0] = True
    wrong = rays_of(*seen_by(1, path() + np.full(3, 0.2), GAP.frames), CAMERAS, missing)
    fill = off_by()
    after, expected, count = constrained(fill, GAP, 0.01, wrong, own(), RATE)
    assert (count, expected) == (0, 0.01)
    np.testing.assert_array_equal(after, fill)


def test_only_a_blob_that_is_alone_makes_a_ray():
    frames = np.arange(50, 70)
    one, two = seen_by(0, path(), frames), seen_by(1, path(), frames[:5])
    order = np.lexsort((np.r_[one[0].camera, two[0].camera], np.r_[one[0].frame, two[0].frame]))
    blobs = Blobs(
        one[0].frames,
        *(
            np.concatenate([getattr(one[0], name), getattr(two[0], name)])[order]
            for name in ("frame", "camera", "xy", "area")
        ),
    )
    labels = Labels.join([one[1], two[1]])[order]
    missing = np.zeros((FRAMES, 2), bool)
    missing[50:68] = True
    rays = rays_of(blobs, labels, CAMERAS, missing)
    assert rays.frame.tolist() == list(range(55, 68)), "where two cameras have one, and where it is measured, is none"
    along = np.einsum("ki,ki->k", path()[rays.frame] - rays.origin, rays.direction)
    np.testing.assert_allclose(rays.origin + along[:, None] * rays.direction, path()[rays.frame], atol=1e-6)
    nobody = Labels(np.full(len(blobs), NO_MARKER), labels.step, labels.confidence)
    assert len(rays_of(blobs, nobody, CAMERAS, missing)) == 0


def test_a_long_gap_is_held_part_by_part(rays, monkeypatch):
    slow = 20.0  # so that what is looked at around a part is none of all
    whole = constrained(off_by(), GAP, 0.01, rays, own(), slow)
    monkeypatch.setattr("addon.core.filling.rays.RAY_LIMITS", type(RAY_LIMITS)(window=13))
    parted = constrained(off_by(), GAP, 0.01, rays, own(), slow)
    np.testing.assert_allclose(parted[0], whole[0], atol=5e-4)
