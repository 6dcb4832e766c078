# SPDX-License-Identifier: GPL-3.0-or-later
"""Marker sets with markers that the built-in ones do not have."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from addon.core.data.markersets import MarkerSet

# By finger the markers, and to which side of the hand's middle they are, of the way to them.
FINGERS = {
    "thumb": (("ThumbTip", "ThumbMiddle"), 0.5),
    "index": (("IDX6",), 0.25),
    "middle": (("MiddleTip",), 0.0),
    "ring": (("RingTip", "RingKnuckle"), -0.15),
    "pinky": (("LittleTip",), -0.3),
}
REACH = {"Middle": 0.07, "Knuckle": 0.04, "Tip": 0.1, "6": 0.1}  # heights from the wrist


def with_markers(markerset: MarkerSet, places: Mapping[str, tuple[str, np.ndarray]]) -> MarkerSet:
    """The set with markers on segments, each at a place (3,) in its axes, heights."""
    segments, spread = markerset.skeleton.segments, markerset.spread
    on, offsets = zip(*places.values(), strict=True)
    more = np.zeros((len(spread.modes), len(places), 3))
    return replace(
        markerset,
        markers=(*markerset.markers, *places),
        attachment=np.concatenate([markerset.attachment, [segments.index(one) for one in on]]),
        offsets=np.concatenate([markerset.offsets, offsets]),
        spread=replace(
            spread,
            modes=np.concatenate([spread.modes, more], axis=1),
            marker_sd=np.concatenate([spread.marker_sd, np.full(len(places), 0.004)]),
        ),
    )


def with_fingers(markerset: MarkerSet) -> MarkerSet:
    """The set with markers on the fingers of both hands, which hang ahead of the forearms."""
    places = {}
    for side in "LR":
        ahead = markerset.offsets[markerset.by_name[f"{side}FIN"]]
        ahead = ahead / np.linalg.norm(ahead)
        aside = np.cross([1.0, 0, 0], ahead)
        across = np.cross(ahead, aside / np.linalg.norm(aside))
        for names, share in FINGERS.values():
            way = ahead + share * across
            for name in names:
                far = next(reach for word, reach in REACH.items() if name.endswith(word))
                places[side + name] = f"hand.{side}", far * way / np.linalg.norm(way)
    return with_markers(markerset, places)
