# SPDX-License-Identifier: GPL-3.0-or-later
"""The built-in marker sets: their markers are the contract's, their bodies look like people."""

import numpy as np
import pytest

from addon.core.body.sides import other_side
from addon.io.markersets import builtin_markersets, open_markerset
from scripts import anatomy

GAIT15 = "SACR RASI LASI RTHI LTHI RKNE LKNE RTIB LTIB RANK LANK RHEE LHEE RTOE LTOE"
BODY26 = (
    "LFHD RFHD LBHD RBHD C7 LSHO RSHO LELB RELB LWRA LWRB RWRA RWRB LFIN RFIN LASI RASI SACR LKNE RKNE LANK RANK LHEE "
    "RHEE LTOE RTOE"
)
BODY39 = (
    "LFHD RFHD LBHD RBHD C7 T10 CLAV STRN RBAK LSHO LUPA LELB LFRM LWRA LWRB LFIN RSHO RUPA RELB RFRM RWRA RWRB RFIN "
    "LASI RASI LPSI RPSI LTHI LKNE LTIB LANK LHEE LTOE RTHI RKNE RTIB RANK RHEE RTOE"
)


@pytest.fixture(scope="module", params=["gait15", "body26", "body39"])
def markerset(request):
    return open_markerset(request.param)


@pytest.mark.parametrize(("name", "markers"), [("gait15", GAIT15), ("body26", BODY26), ("body39", BODY39)])
def test_markers_are_the_contracts(name, markers):
    """Checklist A2."""
    assert open_markerset(name).markers == tuple(markers.split())
    assert name in builtin_markersets()


def test_left_is_left_and_toes_are_ahead(markerset):
    where = dict(zip(markerset.markers, markerset.rest_markers, strict=True))
    for name, place in where.items():
        if other_side(name) in where and other_side(name) != name:
            assert place[1] * (-1 if name[0] == "R" else 1) > 0.01, name
            np.testing.assert_allclose(where[other_side(name)], place * [1, -1, 1], atol=1e-5)
    assert where["LTOE"][0] > where["LHEE"][0] + 0.08
    assert where["LASI"][0] > where["LPSI" if "LPSI" in where else "SACR"][0] + 0.05


@pytest.mark.parametrize(("name", "count"), [("actor41", 41), ("actor53", 53)])
def test_the_sets_of_actors_are_whole_persons_with_poses(name, count):
    markerset = open_markerset(name)
    assert markerset.markers == anatomy.ACTOR_SETS[name].markers
    assert len(markerset) == count
    where = dict(zip(markerset.markers, markerset.rest_markers, strict=True))
    for side, sign in (("L", 1), ("R", -1)):
        assert all(sign * place[1] > 0.01 for marker, place in where.items() if marker[0] == side)
        assert 0.25 < where[f"{side}KNE"][2] < 0.32
        assert 0.9 < where[f"{side}FHD"][2] < 0.98
        on = markerset.skeleton.segments[markerset.attachment[markerset.markers.index(f"{side}MT5")]]
        assert on == f"foot.{side}"
    assert {"head", "thorax", "forearm.L", "forearm.R"} <= {
        markerset.skeleton.segments[segment] for segment in markerset.capsules.segment
    }
    assert markerset.spread.poses.shape == (400, 15, 3)
    # Its licence asks to share alike.
    assert "bd" not in markerset.source["people"].split()


def test_markers_sit_on_their_skin_or_outside(markerset):
    """Beside a capsule of its own segment, a marker's centre is not inside."""
    capsules = markerset.capsules
    for marker, segment in enumerate(markerset.attachment):
        for index in np.flatnonzero(capsules.segment == segment):
            line = capsules.end[index] - capsules.start[index]
            along = (markerset.offsets[marker] - capsules.start[index]) @ line / (line @ line)
            away = markerset.offsets[marker] - capsules.start[index] - np.clip(along, 0, 1) * line
            distance = np.linalg.norm(away)
            assert distance > capsules.radius[index] or distance < 0.6 * capsules.radius[index]


def test_the_gait_papers_names_are_known():
    gait = open_markerset("gait15")
    assert gait.index("s2") == gait.index("SACR")
    assert gait.index("r_l_thigh") == gait.index("RTHI")
    assert gait.index("l_calf") == gait.index("LTIB")
    with pytest.raises(KeyError):
        gait.index("LFHD")
