# SPDX-License-Identifier: GPL-3.0-or-later
"""Gaps filled, with about the error expected, also along rays; fills kept and put in again; smoothing."""

from types import SimpleNamespace

import numpy as np
import pytest

from addon.core.data.progress import finished
from addon.core.data.takes import NO_MARKER, Blobs, Labels
from addon.core.filling.filling import FILL_METHODS, PLAIN, FilledGap, FilledTake, FillOptions, fill_take, kept_fills_of
from addon.core.filling.gaps import Gap
from addon.core.filling.kept import KeptFill, put_fills, replaced_fills, resting_on
from addon.core.filling.rays import MarkerRays, constrained, rays_of
from addon.core.filling.smoothing import count_smoothed, smoothed
from addon.core.geometry.rotations import turn_of
from addon.core.simulation.rigs import ring_rig
from addon.core.simulation.virtual import Act
from tests.core.scenes import built_in, motion_of, walker

RATE = 100.0
FRAMES = 360
LIMB = 5  # markers of each of the three segments of the moving chain


@pytest.fixture(scope="module")
def chain() -> np.ndarray:
    """(T, 15, 3) m: three segments joined end to end that swing and go along, a little soft, with a little noise."""
    rng = np.random.default_rng(3)
    time = np.arange(FRAMES) / RATE
    forms = rng.uniform(-0.1, 0.1, (3, LIMB, 3)) + np.array([0.15, 0, 0])
    place, points = np.stack([time, 0.3 * np.sin(time), 0 * time], axis=1), []
    for index, form in enumerate(forms):
        bend = np.stack([np.sin((2 + index) * time), np.cos(3 * time + index), np.sin(time) + 0.4 * index], axis=1)
        turn = turn_of(0.8 * bend)
        soft = 0.004 * np.sin(5 * time)[:, None, None] * form
        points.append(place[:, None] + np.einsum("tij,tnj->tni", turn, form + soft))
        place = place + turn @ [0.3, 0, 0]
    return np.concatenate(points, axis=1) + 0.0002 * rng.standard_normal((FRAMES, 3 * LIMB, 3))


def holed(xyz: np.ndarray, *gaps: tuple[int, int, int]) -> np.ndarray:
    """The take without a marker from one frame up to another, for each (marker, start, stop)."""
    cut = xyz.copy()
    for marker, start, stop in gaps:
        cut[start:stop, marker] = np.nan
    return cut


def filled(xyz: np.ndarray, **options):
    return finished(fill_take(xyz, RATE, FillOptions(**options)))


def off(found, truth: np.ndarray, marker: int, start: int, stop: int) -> float:
    """Mean error, m."""
    return float(np.linalg.norm(found.xyz[start:stop, marker] - truth[start:stop, marker], axis=1).mean())


@pytest.mark.parametrize("seed", range(2))
def test_measured_samples_stay_and_filled_ones_are_finite(chain, seed):
    rng = np.random.default_rng(seed)
    gaps = [(rng.integers(15), start, start + rng.integers(1, 40)) for start in rng.integers(0, FRAMES - 1, 6)]
    cut = holed(chain, *gaps)
    cut[:, 4] = np.nan  # a marker that was never seen
    found = filled(cut)
    measured = np.isfinite(cut)
    assert (found.xyz[measured] == cut[measured]).all()
    assert np.isfinite(found.xyz[found.filled]).all()
    assert not found.filled[measured[..., 0]].any()
    assert np.isnan(found.xyz[~found.filled & ~measured[..., 0]]).all()
    said = np.zeros_like(found.filled)
    for one in found.gaps:
        said[one.gap.start : one.gap.stop, one.gap.marker] = True
    assert (said == found.filled).all()
    assert all(0 < one.expected < 0.1 for one in found.gaps)
    assert {one.gap.marker for one in (*found.gaps, *found.left)} <= set(range(15)) - {4}


@pytest.mark.parametrize("method", [method for method in FILL_METHODS if method != "body"])
def test_what_is_filled_turns_and_moves_with_the_take(chain, method):
    turn, place = turn_of(np.array([0.3, -0.8, 2.0])), np.array([3.0, -2.0, 0.5])
    cut = holed(chain, (2, 100, 140), (3, 120, 130), (11, 200, 206))
    here = filled(cut, method=method)
    there = filled(cut @ turn.T + place, method=method)
    assert (here.filled == there.filled).all()
    assert here.filled.sum() == 56
    assert [one.method for one in here.gaps] == [one.method for one in there.gaps]
    # What is learned is searched for, and the search ends a rounding error apart.
    assert np.abs(here.xyz[here.filled] @ turn.T + place - there.xyz[here.filled]).max() < 1e-5


def test_markers_are_carried_through_long_gaps_alone_or_together_about_as_far_off_as_expected(chain):
    gaps = [(7, 120, 200), (1, 40, 100), (12, 220, 300), (9, 250, 330), (3, 150, 250)]
    found = filled(holed(chain, *gaps))
    got = [off(found, chain, *gap) for gap in gaps]
    spline = filled(holed(chain, *gaps), method="spline", max_off_m=np.inf)
    assert max(got) < 0.001
    assert np.mean([off(spline, chain, *gap) for gap in gaps]) > 20 * max(got)
    expected = [one.expected for one in found.gaps]
    assert 0.5 < np.mean(expected) / np.mean(got) < 2
    # A method that does not say it is tried on gaps like each.
    told = np.mean([one.expected for one in spline.gaps])
    assert 0.5 < told / np.mean([off(spline, chain, *gap) for gap in gaps]) < 2
    gaps = [(5, 150, 210), (6, 150, 210), (7, 160, 190), (8, 140, 200)]
    found = filled(holed(chain, *gaps))
    assert len(found.gaps) == 4
    assert max(off(found, chain, *gap) for gap in gaps) < 0.03
    alone = filled(holed(chain, gaps[0]))
    assert alone.gaps[0].expected < next(one for one in found.gaps if one.gap.marker == 5).expected


def test_nothing_is_drawn_beyond_the_ends_by_what_cannot_carry_it(chain):
    cut = holed(chain, (2, 0, 30), (8, FRAMES - 30, FRAMES))
    assert not filled(cut, method="spline").filled.any()
    assert "at an end of the take" in filled(cut, method="spline").left[0].reason
    carried = filled(cut)
    assert {one.method for one in carried.gaps} == {"regression"}
    assert off(carried, chain, 2, 0, 30) < 0.002
    strict = filled(cut, max_open_m=0.0)
    assert not strict.filled.any()
    assert "are allowed at an end of the take" in strict.left[0].reason
    lonely = holed(chain[:, :1], (0, 0, 30))
    assert not filled(lonely).filled.any()


def test_no_trial_is_made_twice(chain, monkeypatch):
    tried = []

    def carried(_take, gap, *_):
        tried.append(gap)
        return None if tried[1:] else chain[:1, 0]

    monkeypatch.setitem(PLAIN, "rigid", carried)
    filled(holed(chain, (5, 150, 151)), method="rigid")
    assert len(tried) > 5 and len(set(tried)) == len(tried)


def test_gaps_of_others_do_not_mislead_and_a_spline_bridges_where_nothing_else_is_known(chain):
    holes = [(marker, start, start + 12) for marker in range(5, 15) for start in range(8 * marker - 40, 350, 90)]
    found = filled(holed(chain, (2, 100, 140), *holes), markers=(2,))
    [one] = found.gaps
    assert np.isfinite(one.expected)
    assert off(found, chain, 2, 100, 140) < 0.002
    cut = holed(chain[:, :1], (0, 100, 104))
    found = filled(cut)
    assert [one.method for one in found.gaps] == ["spline"]
    assert off(found, chain, 0, 100, 104) < 0.001


@pytest.mark.parametrize("every", [2, 4])
def test_markers_that_are_there_in_some_frames_alone_are_filled_between_these(chain, every):
    pair = chain[:, :2]
    cut = np.where((np.arange(FRAMES) % every == 0)[:, None, None], pair, np.nan)
    found = filled(cut)
    assert {(one.method, *one.ends) for one in found.gaps} == {("spline", True, True)}
    assert {one.gap.stop for one in found.left} == {FRAMES}
    last = found.left[0].gap.start
    assert found.filled[:last].sum() == np.isnan(cut[:last, :, 0]).sum()
    errors = np.linalg.norm(found.xyz - pair, axis=2)[found.filled]
    assert errors.mean() < np.mean([one.expected for one in found.gaps]) < 0.01


def test_a_gap_whose_error_would_be_large_is_left_and_what_stands_still_is_filled_where_it_is(chain):
    left = filled(holed(chain[:, :1], (0, 100, 220)), max_off_m=0.01)
    assert not left.gaps
    assert "where 10 mm are allowed" in left.left[0].reason
    still = np.tile(np.random.default_rng(1).uniform(0, 1, (1, 6, 3)), (100, 1, 1))
    for method in ("regression", "rigid", "pca"):
        found = filled(holed(still, (0, 20, 40)), method=method)
        assert np.abs(found.xyz - still).max() < 1e-6, method


def test_a_clavicle_keeps_still_while_its_marker_is_missing():
    markerset = built_in("body39")
    truth, shoulder = walker("body39", 4, [Act(1.2, stride=1.0)], RATE, noise=0.0), markerset.index("LSHO")
    given = holed(truth, (shoulder, 20, 60)), RATE, FillOptions("body"), markerset, np.arange(len(markerset))
    assert off(finished(fill_take(*given)), truth, shoulder, 20, 60) < 0.002


def test_the_fitted_body_fills_what_its_markers_leave_open():
    markerset = built_in("gait15")
    truth = walker("gait15", 4, [Act(1.2, stride=1.0)], RATE, noise=0.0)
    knee, ankle = markerset.index("RKNE"), markerset.index("RANK")
    cut, columns = holed(truth, (knee, 30, 70), (ankle, 40, 60)), np.arange(len(markerset))
    found = finished(fill_take(cut, RATE, FillOptions("body"), markerset, columns))
    assert {one.method for one in found.gaps} == {"body"}
    assert off(found, truth, knee, 30, 70) < 0.01
    assert all(one.expected < 0.02 for one in found.gaps)
    alone = finished(fill_take(cut, RATE, FillOptions("body")))
    words = "has no body to be filled by: that needs a model of these markers"
    assert [one.reason for one in alone.left] == [words] * 2
    elsewhere = finished(fill_take(cut, RATE, FillOptions("body"), markerset, np.where(columns == knee, -1, columns)))
    assert [one.gap.marker for one in elsewhere.gaps] == [ankle]
    both = finished(fill_take(cut, RATE, FillOptions(), markerset, columns))
    assert both.filled.sum() == 60


@pytest.mark.parametrize(("stray", "side"), [(slice(140, 142), "after"), (slice(98, 100), "before")])
def test_a_stray_sample_beside_a_gap_holds_no_fill(chain, stray, side):
    cut = holed(chain, (2, 100, 140), (7, 100, 140), (2, 142, 150), (2, 90, 98))
    cut[stray, 2] += [2.5, 0, 0]
    found = filled(cut)
    [reason] = [one.reason for one in found.left if (one.gap.start, one.gap.marker) == (100, 2)]
    assert f"right {side} it" in reason and reason.startswith("rests on a stray point")
    assert np.isnan(found.xyz[100:140, 2]).all()
    assert (found.xyz[stray, 2] == cut[stray, 2]).all() and not found.filled[stray, 2].any()
    clean = filled(holed(chain, (7, 100, 140)))
    assert off(found, chain, 7, 100, 140) < 2 * off(clean, chain, 7, 100, 140) + 0.001
    assert {(one.gap.start, one.gap.marker) for one in found.gaps} >= {(100, 7)}


def test_ends_too_far_apart_and_an_end_of_the_take_leave_a_gap_and_a_fast_marker_does_not(chain):
    cut = holed(chain, (2, 180, 186))
    cut[186:, 2] += [3.0, 0, 0]
    found = filled(cut)
    [left] = found.left
    assert left.reason.startswith("has ends 3.") and "6 frames" in left.reason
    fast = chain.copy()
    fast[:, 2] += np.stack([0.9 * np.sin(2 * np.pi * 2 * np.arange(FRAMES) / RATE), *np.zeros((2, FRAMES))], axis=1)
    found = filled(holed(fast, (2, 180, 186)))
    assert not found.left
    found = filled(holed(chain, (2, 0, 12), (3, 100, 104), (4, FRAMES - 9, FRAMES)))
    assert [one.ends for one in found.gaps] == [(False, True), (True, True), (True, False)]
    kept = kept_fills_of(found, [str(marker) for marker in range(15)], np.arange(FRAMES))
    assert [resting_on(one.ends) for one in kept] == ["its end", "both ends", "its start"]


NAMES = ("A", "B")
NUMBERS = 50 + np.arange(12)
GAPS = (Gap(4, 7, 0), Gap(9, 12, 1))


@pytest.fixture
def take() -> SimpleNamespace:
    """Markers with two gaps, the second at the end, and what they were filled with."""
    whole = np.random.default_rng(1).normal(size=(12, 2, 3))
    markers = whole.copy()
    for gap in GAPS:
        markers[gap.start : gap.stop, gap.marker] = np.nan
    flags = np.isnan(markers[..., 0])
    filled = FilledTake(whole, flags, (FilledGap(GAPS[0], "pca", 0.002), FilledGap(GAPS[1], "spline", np.nan)), ())
    return SimpleNamespace(markers=markers, whole=whole, flags=flags, fills=kept_fills_of(filled, NAMES, NUMBERS))


@pytest.mark.parametrize(
    ("frame", "marker", "value", "which", "reason"),
    [
        (5, 0, 1.0, 0, "is named in some of its frames"),
        (3, 0, 1.0, 0, "right before or after"),
        (7, 0, np.nan, 0, "right before or after"),
        (8, 1, np.nan, 1, "right before or after"),
    ],
)
def test_a_fill_is_left_out_where_the_take_is_another_around_it(take, frame, marker, value, which, reason):
    take.markers[frame, marker] = value
    motion, unfit = put_fills(motion_of(take.markers, take.whole, NUMBERS[0]), NAMES, take.fills)
    assert reason in unfit[which]
    assert unfit[1 - which] == ""
    filled = motion.residual == 0
    assert filled[:, 1 - marker].any()
    assert not filled[:, marker].any()


def test_fills_of_other_markers_or_frames_are_left_out_and_new_ones_take_the_place_of_those_they_meet(take):
    one = take.fills[0]
    for other, reason in (
        (KeptFill("C", one.first, one.last, "pca", 0.0, one.path), "no such marker"),
        (KeptFill("A", 60, 70, "pca", 0.0, np.zeros((13, 3))), "not all of its frames"),
    ):
        motion, unfit = put_fills(motion_of(take.markers, take.whole, NUMBERS[0]), NAMES, [other])
        assert reason in unfit[0]
        np.testing.assert_array_equal(motion.markers, take.markers)
    new = KeptFill("A", 56, 58, "rigid", 0.0, np.zeros((5, 3)))
    assert replaced_fills(take.fills, [new]) == (new, take.fills[1])
    assert replaced_fills(take.fills, []) == take.fills


HERTZ = 120.0
TIME = np.arange(720) / HERTZ


def swing(hertz: float) -> np.ndarray:
    """(T, 1, 3) m, a swing of one metre to each side."""
    return np.repeat(np.sin(2 * np.pi * hertz * TIME)[:, None, None], 3, axis=2)


def amplitude(xyz: np.ndarray) -> float:
    return float(np.abs(xyz[200:-200]).max())


@pytest.mark.parametrize("cutoff", [4.0, 8.0, 15.0])
def test_at_the_cut_off_the_amplitude_is_down_by_3_db(cutoff):
    assert amplitude(smoothed(swing(cutoff), HERTZ, cutoff)) == pytest.approx(np.sqrt(0.5), abs=0.01)
    assert amplitude(smoothed(swing(cutoff / 5), HERTZ, cutoff)) == pytest.approx(1, abs=0.01)
    assert amplitude(smoothed(swing(3 * cutoff), HERTZ, cutoff)) < 0.03


def test_nothing_lags_stretches_stand_alone_and_gaps_stay():
    slow = swing(1.5)
    both = smoothed(slow + 0.1 * swing(40.0), HERTZ, 6.0)
    shifts = range(-5, 6)
    off = [np.abs(np.roll(both, shift, axis=0) - slow)[200:-200].mean() for shift in shifts]
    assert shifts[int(np.argmin(off))] == 0
    xyz = np.concatenate([swing(2.0), 3 + 0 * swing(1.0)], axis=1)
    xyz[300:310, 0] = xyz[500, 0] = xyz[503, 0] = np.nan
    xyz[350:, 1] = 7
    calm = smoothed(xyz, HERTZ, 6.0)
    np.testing.assert_array_equal(np.isnan(calm), np.isnan(xyz))
    np.testing.assert_array_equal(calm[501:503, 0], xyz[501:503, 0])
    assert count_smoothed(xyz) == [720 - 12 - 2, 720], "two samples between gaps stay"
    alone = smoothed(xyz[310:500, :1], HERTZ, 6.0)
    np.testing.assert_allclose(calm[310:500, :1], alone)
    still = smoothed(0 * xyz[:200] + 0.25, HERTZ, 6.0)
    np.testing.assert_allclose(still, 0.25, atol=1e-12)


SHOT, RATE = 200, 100.0
CAMERAS = ring_rig(4)
GAP = Gap(60, 120, 0)


BESIDE = np.ones(SHOT, bool)
BESIDE[GAP.start : GAP.stop] = False
WAY = np.column_stack([0.3 * np.sin(2 * np.arange(SHOT) / RATE), 0.2 * np.arange(SHOT) / RATE, np.ones(SHOT)])
# A fill whose error comes and goes, m.
OFF = WAY[~BESIDE] + 0.01 * np.sin(np.linspace(0, np.pi, len(GAP) + 2))[1:-1, None] * [1.0, -0.5, 0.7]


def seen_by(camera: int, xyz: np.ndarray, frames: np.ndarray) -> tuple[Blobs, Labels]:
    """One blob of a marker in some frames of a take, in one camera."""
    pixels = CAMERAS.project(xyz[frames])[camera]
    count = len(frames)
    blobs = Blobs(np.arange(1, SHOT + 1), frames, np.full(count, camera), pixels, np.full(count, np.nan))
    return blobs, Labels(np.zeros(count, int), np.ones(count, int), np.ones(count))


def rays_at(xyz: np.ndarray) -> MarkerRays:
    """The rays of a marker that is in its gap where a path has it, for one camera."""
    missing = np.column_stack([~BESIDE, np.zeros(SHOT, bool)])
    return rays_of(*seen_by(1, xyz, GAP.frames), CAMERAS, missing)


RAYS = rays_at(WAY)


def parts(fill: np.ndarray, rays: MarkerRays) -> tuple[np.ndarray, np.ndarray]:
    """m, how far a fill is off along the rays and across them."""
    off = fill[rays.frame - GAP.start] - WAY[rays.frame]
    along = np.einsum("ki,ki->k", off, rays.direction)
    return np.abs(along), np.linalg.norm(off - along[:, None] * rays.direction, axis=1)


def test_a_fill_lies_on_the_rays_and_is_as_deep_as_before():
    after, expected, count = constrained(OFF, GAP, 0.01, RAYS, BESIDE, RATE)
    assert count == len(GAP) == len(RAYS)
    (deep, aside), (still_deep, left) = parts(OFF, RAYS), parts(after, RAYS)
    assert left.max() < 0.1 * aside.max()
    np.testing.assert_allclose(still_deep, deep, atol=0.15 * deep.max())
    assert 0.003 < expected < 0.01
    whole = np.concatenate([WAY[[GAP.start - 1]], after, WAY[[GAP.stop]]])
    jerk = np.linalg.norm(np.diff(whole, 2, axis=0), axis=1)
    assert jerk.max() < 0.001, "it meets its ends"


def test_rays_of_some_frames_draw_their_neighbours_along_and_one_far_off_is_another_markers():
    some = MarkerRays(*(getattr(RAYS, name)[20:40] for name in ("marker", "frame", "origin", "direction", "spread")))
    after, _, count = constrained(OFF, GAP, 0.01, some, BESIDE, RATE)
    assert count == 20
    assert np.linalg.norm(np.diff(after - OFF, axis=0), axis=1).max() < 0.003
    assert parts(after, some)[1].max() < 0.002
    np.testing.assert_allclose(after[0], OFF[0], atol=0.002)
    after, expected, count = constrained(OFF, GAP, 0.01, rays_at(WAY + 0.2), BESIDE, RATE)
    assert (count, expected) == (0, 0.01)
    np.testing.assert_array_equal(after, OFF)


def test_only_a_blob_that_is_alone_makes_a_ray():
    (one, first), (two, second) = seen_by(0, WAY, np.arange(50, 70)), seen_by(1, WAY, np.arange(50, 55))
    order = np.argsort(np.r_[one.frame, two.frame], kind="stable")
    columns = ("frame", "camera", "xy", "area")
    joined = (np.concatenate([getattr(one, name), getattr(two, name)])[order] for name in columns)
    blobs, labels = Blobs(one.frames, *joined), Labels.join([first, second])[order]
    missing = np.zeros((SHOT, 2), bool)
    missing[50:68] = True
    rays = rays_of(blobs, labels, CAMERAS, missing)
    assert rays.frame.tolist() == list(range(55, 68)), "where two cameras have one, and where it is measured, is none"
    along = np.einsum("ki,ki->k", WAY[rays.frame] - rays.origin, rays.direction)
    np.testing.assert_allclose(rays.origin + along[:, None] * rays.direction, WAY[rays.frame], atol=1e-6)
    nobody = Labels(np.full(len(blobs), NO_MARKER), labels.step, labels.confidence)
    assert len(rays_of(blobs, nobody, CAMERAS, missing)) == 0
