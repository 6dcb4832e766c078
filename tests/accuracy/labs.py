# SPDX-License-Identifier: GPL-3.0-or-later
"""Takes of other labs than the one that the built-in sets were learned from, in the markers of `gait15`.

Each lab's own markers stand in for those of the set, where the lab wears them: thigh and shank markers of clusters, the
middle between two hip markers for SACR, and so on. So people, places of the markers and motions are all strangers.
"""

import numpy as np

from .people import DATA, GAIT15, read_c3d

_LEG = ("ASI", "THI", "KNE", "TIB", "ANK", "HEE", "TOE")


def _names_in(sacrum: str, leg: str) -> dict[str, str]:
    """Of each marker of `gait15` the lab's markers whose middle stands in for it; those of a leg without R or L."""
    pairs = list(zip(_LEG, leg.split(","), strict=True))
    legs = {side + name: " ".join(side + one for one in own.split()) for side in "RL" for name, own in pairs}
    return {"SACR": sacrum, **legs}


PLUG_IN_GAIT = _names_in("RPSI LPSI", ",".join(_LEG))
ACTORS41 = _names_in("RBWT LBWT", "FWT,THI,KNE,SHN,ANK,HEE,TOE")
ACTORS53 = _names_in("RBWT LBWT", "FWT,HIP,KNE,SHN,ANK,HEL,TOE")
VICON12 = _names_in("RPSI LPSI", "ASI,THL,FCL,TBC,MALL,CAL,MT1 MT5")
OPENSIM = _names_in("RPSI LPSI", "ASI,TH3,LFC,TB2,LMAL,CAL,MT2")
WALKS = {
    "vicon12": ("rooms/vicon12/walking_1.c3d", VICON12),
    "opensim walking5": ("people/gaps/walking5.c3d", OPENSIM),
    "opensim test_walking": ("people/gaps/test_walking.c3d", OPENSIM),
}
OTHER_MOTIONS = {
    "serve": ("people/tennis/kinematics_tennis_serve.c3d", PLUG_IN_GAIT),
    "ball": ("people/cmu41/ball/basketball.c3d", ACTORS41),
    "bd": ("people/cmu41/bd/HDM_bd_05-01_01_120.c3d", ACTORS41),
    "s02": ("people/cmu41/s02/02_05.c3d", ACTORS41),
    "s135": ("people/cmu41/s135/135_02.c3d", ACTORS41),
    "p1": ("people/actors53/p1/freeform.c3d", ACTORS53),
    "p2": ("people/actors53/p2/squat.c3d", ACTORS53),
}
Y_UP = ("p1", "p2")


def gait15_of(name: str) -> tuple[np.ndarray, float]:
    """(T, 15, 3) m of a take of `WALKS` or `OTHER_MOTIONS`, NaN where missing, and its rate a second."""
    file, theirs = {**WALKS, **OTHER_MOTIONS}[name]
    names, xyz, rate = read_c3d(DATA / file)
    if name in Y_UP:
        xyz = xyz[..., [0, 2, 1]] * [1.0, -1.0, 1.0]
    own = [[names.index(one) for one in theirs[marker].split()] for marker in GAIT15]
    return np.stack([xyz[:, some].mean(axis=1) for some in own], axis=1), rate
