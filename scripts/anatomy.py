# SPDX-License-Identifier: GPL-3.0-or-later
"""Tables of the whole body: its segments, the usual markers and where each sits, and the built-in marker sets.

Names are those of Plug-in Gait and of Helen Hayes, as laboratories write them. Sides are L and R before a marker's
name and .L and .R behind a segment's, which is how Blender finds the other side.
"""

from dataclasses import dataclass

from addon.core.body.sides import BODY_SIDES

NO_LIFT = (0.0, 0.0, 0.0)


@dataclass(frozen=True)
class SegmentSite:
    """A segment: its parent, and the joint at its near end as recorded joint centres or as a mix of other points.

    landmarks  names of joint centres that capture software writes among the points
    mix        {point: share} where no landmark is known; the shares add up to 1
    lift       what is added to the mix, heights (x forward, y outward, z up)
    sd         physical: how far people's joints stray from the mean, heights
    """

    name: str
    parent: str | None
    landmarks: tuple[str, ...] = ()
    mix: tuple[tuple[str, float], ...] = ()
    lift: tuple[float, float, float] = NO_LIFT
    sd: float = 0.015


@dataclass(frozen=True)
class MarkerSite:
    """A marker: its segment, and where it sits when no take of the training shows it (as in `SegmentSite`)."""

    name: str
    segment: str
    mix: tuple[tuple[str, float], ...] = ()
    lift: tuple[float, float, float] = NO_LIFT


@dataclass(frozen=True)
class SetSite:
    """A built-in marker set: its markers, other names for them, and whether it has more than the lower body."""

    name: str
    description: str
    markers: tuple[str, ...]
    aliases: tuple[tuple[str, str], ...]
    whole_body: bool


_ROOT = SegmentSite("pelvis", None, mix=(("LHJC", 0.5), ("RHJC", 0.5)))
_TRUNK = (
    SegmentSite("thorax", "pelvis", mix=(("LHJC", 0.2), ("RHJC", 0.2), ("SACR", 0.6)), lift=(0.02, 0, 0.06), sd=0.02),
    SegmentSite("head", "thorax", mix=(("C7", 0.65), ("CLAV", 0.35)), lift=(0.0, 0, 0.035), sd=0.015),
)


def _arm(side: str) -> tuple[SegmentSite, ...]:
    return (
        SegmentSite(f"upper_arm.{side}", "thorax", (f"{side}CLO",)),
        SegmentSite(f"forearm.{side}", f"upper_arm.{side}", (f"{side}HUO",)),
        # One marker does not show how the hand turns: the wrist is held half-way between its two markers.
        SegmentSite(f"hand.{side}", f"forearm.{side}", mix=((f"{side}WRA", 0.5), (f"{side}WRB", 0.5)), sd=0.003),
    )


def _leg(side: str) -> tuple[SegmentSite, ...]:
    return (
        SegmentSite(f"thigh.{side}", "pelvis", (f"{side}HJC",)),
        SegmentSite(f"shank.{side}", f"thigh.{side}", (f"{side}FEO",)),
        SegmentSite(f"foot.{side}", f"shank.{side}", (f"{side}TIO",), sd=0.01),
    )


LOWER_SEGMENTS = (_ROOT, *_leg("L"), *_leg("R"))
WHOLE_SEGMENTS = (_ROOT, *_TRUNK, *_arm("L"), *_arm("R"), *_leg("L"), *_leg("R"))

_CENTRAL = (
    MarkerSite("SACR", "pelvis"),
    *(MarkerSite(name, "thorax") for name in ("C7", "T2", "T6", "T10", "T12", "CLAV", "STRN", "RBAK")),
)


def _sided(side: str) -> tuple[MarkerSite, ...]:
    arm, forearm, leg = f"upper_arm.{side}", f"forearm.{side}", ("thigh", "shank", "foot")
    elbow = ((f"{side}HUO", 0.5),)
    on_thigh, on_shank = ("THI", "KNE"), ("TIB", "ANK", "HFB", "TUB", "SHN", "MMA")
    on_foot = ("HEE", "TOE", "LCA", "STL", "NAV", "P1M", "P5M", "D5M")
    on_legs = zip(leg, (on_thigh, on_shank, on_foot), strict=True)
    return (
        MarkerSite(f"{side}ASI", "pelvis"),
        MarkerSite(f"{side}PSI", "pelvis", (("SACR", 1.0),), (0.0, 0.025, 0.0)),
        MarkerSite(f"{side}FHD", "head"),
        MarkerSite(f"{side}BHD", "head"),
        MarkerSite(f"{side}SHO", "thorax"),
        MarkerSite(f"{side}UPA", arm, (*elbow, (f"{side}CLO", 0.5)), (0.0, 0.03, 0.0)),
        MarkerSite(f"{side}ELB", arm),
        MarkerSite(f"{side}FRM", forearm, (*elbow, (f"{side}WRA", 0.25), (f"{side}WRB", 0.25)), (0.0, 0.025, 0.0)),
        MarkerSite(f"{side}WRA", forearm),
        MarkerSite(f"{side}WRB", forearm),
        MarkerSite(f"{side}FIN", f"hand.{side}"),
        *(MarkerSite(side + name, f"{segment}.{side}") for segment, names in on_legs for name in names),
    )


@dataclass(frozen=True)
class CapsuleSite:
    """A capsule on a segment: its ends as mixes of joints and markers with lifts (see `SegmentSite`), its radius.

    The radius is a little less than people's: a marker wrongly thought visible does less harm than one wrongly hidden.
    """

    segment: str
    start: tuple[tuple[tuple[str, float], ...], tuple[float, float, float]]
    end: tuple[tuple[tuple[str, float], ...], tuple[float, float, float]]
    radius: float


def _on(joint: str, forward: float = 0.0, outward: float = 0.0, up: float = 0.0):
    return ((joint, 1.0),), (forward, outward, up)


def _between(one: str, two: str, share: float, forward: float = 0.0):
    return ((one, 1 - share), (two, share)), (forward, 0.0, 0.0)


def _arm_capsules(side: str) -> tuple[CapsuleSite, ...]:
    arm, forearm, hand = f"upper_arm.{side}", f"forearm.{side}", f"hand.{side}"
    return (
        CapsuleSite(arm, _on(arm), _on(forearm), 0.024),
        CapsuleSite(forearm, _on(forearm), _between(forearm, hand, 0.5), 0.022),
        CapsuleSite(forearm, _between(forearm, hand, 0.5), _on(hand), 0.016),
        CapsuleSite(hand, _between(hand, f"{side}FIN", 0.4), _between(hand, f"{side}FIN", 1.3), 0.013),
    )


def _leg_capsules(side: str) -> tuple[CapsuleSite, ...]:
    thigh, shank, foot = f"thigh.{side}", f"shank.{side}", f"foot.{side}"
    return (
        CapsuleSite(thigh, _on(thigh), _between(thigh, shank, 0.5), 0.043),
        CapsuleSite(thigh, _between(thigh, shank, 0.5), _on(shank), 0.032),
        CapsuleSite(shank, _on(shank, -0.01, 0, -0.01), _between(shank, foot, 0.5, -0.01), 0.03),
        CapsuleSite(shank, _between(shank, foot, 0.5, -0.005), _on(foot), 0.021),
        CapsuleSite(foot, _on(foot, -0.015, 0, -0.016), _on(foot, 0.085, 0.012, -0.022), 0.013),
    )


_PELVIS_CAPSULE = CapsuleSite("pelvis", _on("pelvis", -0.005, 0.04, 0.02), _on("pelvis", -0.005, -0.04, 0.02), 0.056)


_TRUNK_CAPSULES = (
    CapsuleSite("thorax", _on("thorax", 0.015, 0.028, 0.015), _on("thorax", 0.008, 0.035, 0.17), 0.053),
    CapsuleSite("thorax", _on("thorax", 0.015, -0.028, 0.015), _on("thorax", 0.008, -0.035, 0.17), 0.053),
    CapsuleSite("thorax", _on("head", 0, 0, -0.03), _on("head", 0.005, 0, 0.03), 0.03),
    CapsuleSite("head", _on("head", 0.018, 0, 0.04), _on("head", 0.02, 0, 0.09), 0.047),
)
# The lower body's marker set knows nothing of the trunk but that it is there and hides things.
_STIFF_TRUNK_CAPSULES = (
    CapsuleSite("pelvis", _on("pelvis", -0.005, 0.03, 0.09), _on("pelvis", -0.005, 0.035, 0.27), 0.05),
    CapsuleSite("pelvis", _on("pelvis", -0.005, -0.03, 0.09), _on("pelvis", -0.005, -0.035, 0.27), 0.05),
    CapsuleSite("pelvis", _on("pelvis", 0.005, 0, 0.33), _on("pelvis", 0.01, 0, 0.44), 0.03),
)
_LEGS_CAPSULES = (*_leg_capsules("L"), *_leg_capsules("R"))
LOWER_CAPSULES = (_PELVIS_CAPSULE, *_STIFF_TRUNK_CAPSULES, *_LEGS_CAPSULES)
WHOLE_CAPSULES = (_PELVIS_CAPSULE, *_TRUNK_CAPSULES, *_arm_capsules("L"), *_arm_capsules("R"), *_LEGS_CAPSULES)

MARKERS = (*_CENTRAL, *_sided("L"), *_sided("R"))


def _names(text: str) -> tuple[str, ...]:
    return tuple(text.split())


_SIDE_WORDS = (("L", "l"), ("R", "r"))
_LEG_ALIASES = (
    ("sacrum", "SACR"),
    ("s2", "SACR"),
    *((f"{word}_asis", f"{side}ASI") for side, word in _SIDE_WORDS),
    *((f"{word}_l_thigh", f"{side}THI") for side, word in _SIDE_WORDS),
    *((f"{word}_thigh", f"{side}THI") for side, word in _SIDE_WORDS),
    *((f"{word}_bar_1", f"{side}THI") for side, word in _SIDE_WORDS),
    *((f"{word}_wand_1", f"{side}THI") for side, word in _SIDE_WORDS),
    *((f"{word}_knee", f"{side}KNE") for side, word in _SIDE_WORDS),
    *((f"{word}_knee_1", f"{side}KNE") for side, word in _SIDE_WORDS),
    *((f"{word}_calf", f"{side}TIB") for side, word in _SIDE_WORDS),
    *((f"{word}_bar_2", f"{side}TIB") for side, word in _SIDE_WORDS),
    *((f"{word}_wand_2", f"{side}TIB") for side, word in _SIDE_WORDS),
    *((f"{word}_ankle", f"{side}ANK") for side, word in _SIDE_WORDS),
    *((f"{word}_mall", f"{side}ANK") for side, word in _SIDE_WORDS),
    *((f"{word}_heel", f"{side}HEE") for side, word in _SIDE_WORDS),
    *((f"{word}_toe", f"{side}TOE") for side, word in _SIDE_WORDS),
    *((f"{word}_met", f"{side}TOE") for side, word in _SIDE_WORDS),
)
_BODY_ALIASES = tuple((f"{side}FWT", f"{side}ASI") for side in BODY_SIDES)
_WHOLE_ALIASES = (*_BODY_ALIASES, *((f"{side}BWT", f"{side}PSI") for side in BODY_SIDES))

# Markers of the sets that actors wear, and the usual marker that sits in the same place or next to it.
_ACTOR_SITES = (("RBAC", "RBAK"), ("LSHN", "LTIB"), ("RSHN", "RTIB"), *_WHOLE_ALIASES)


@dataclass(frozen=True)
class ActorSet:
    """A built-in set that is laid on the body of another one: its markers, and which of them that one has.

    body   the set whose body it takes
    sites  (marker, the body's marker at the same place) where the names are not the same
    """

    name: str
    description: str
    markers: tuple[str, ...]
    body: str
    sites: tuple[tuple[str, str], ...]


SETS = {
    site.name: site
    for site in (
        SetSite(
            "gait15",
            "Helen Hayes lower body for gait: 15 markers",
            _names("SACR RASI LASI RTHI LTHI RKNE LKNE RTIB LTIB RANK LANK RHEE LHEE RTOE LTOE"),
            _LEG_ALIASES,
            whole_body=False,
        ),
        SetSite(
            "body26",
            "Whole body: 26 markers",
            _names(
                "LFHD RFHD LBHD RBHD C7 LSHO RSHO LELB RELB LWRA LWRB RWRA RWRB LFIN RFIN LASI RASI SACR LKNE "
                "RKNE LANK RANK LHEE RHEE LTOE RTOE"
            ),
            _BODY_ALIASES,
            whole_body=True,
        ),
        SetSite(
            "body39",
            "Plug-in Gait full body: 39 markers",
            _names(
                "LFHD RFHD LBHD RBHD C7 T10 CLAV STRN RBAK LSHO LUPA LELB LFRM LWRA LWRB LFIN RSHO RUPA RELB "
                "RFRM RWRA RWRB RFIN LASI RASI LPSI RPSI LTHI LKNE LTIB LANK LHEE LTOE RTHI RKNE RTIB RANK RHEE "
                "RTOE"
            ),
            _WHOLE_ALIASES,
            whole_body=True,
        ),
    )
}

ACTOR_SETS = {
    site.name: site
    for site in (
        ActorSet(
            "actor41",
            "Whole body of actors, as at CMU and in HDM05: 41 markers",
            _names(
                "LFHD RFHD LBHD RBHD C7 T10 CLAV STRN RBAC LSHO LUPA LELB LFRM LWRA LWRB LFIN RSHO RUPA RELB RFRM RWRA "
                "RWRB RFIN LFWT RFWT LBWT RBWT LTHI LKNE LSHN LANK LHEE LTOE LMT5 RTHI RKNE RSHN RANK RHEE RTOE RMT5"
            ),
            "body39",
            _ACTOR_SITES,
        ),
        ActorSet(
            "actor53",
            "Whole body of actors, as in Vicon Blade: 53 markers",
            _names(
                "ARIEL LFHD LBHD RFHD RBHD C7 T10 CLAV STRN LFSH LBSH LUPA LELB LIEL LOWR LIWR LWRE LIHAND LOHAND RFSH "
                "RBSH RUPA RELB RIEL ROWR RIWR RWRE RIHAND ROHAND LFWT LMWT LBWT RFWT RMWT RBWT LHIP LKNE LKNI LSHN "
                "LANK LHEL LMT5 LMT1 LTOE RHIP RKNE RKNI RSHN RANK RHEL RMT5 RMT1 RTOE"
            ),
            "actor41",
            tuple(
                (side + name, side + meant)
                for side in BODY_SIDES
                for name, meant in (("HEL", "HEE"), ("IWR", "WRA"), ("OWR", "WRB"))
            ),
        ),
    )
}
