# SPDX-License-Identifier: GPL-3.0-or-later
"""What is known of markers before anything is recorded: how they move, and how exactly they are seen."""

from dataclasses import dataclass

import numpy as np

SIGMAS = 3.0  # standard deviations beyond which something is no chance: 0.3 % of a normal distribution lie there
# m, how tall people are: a child of two years, and what hardly anybody is taller than
HEIGHTS_M = 0.9, 2.2  # physical


@dataclass(frozen=True)
class MarkerLimits:
    """Limits of motion. "Recorded" are about 45 labelled takes at 100 to 120 Hz."""

    # m/s², how hard a marker's velocity changes, standard deviation; 99 % of the samples of every recorded walk are
    # below 46, three of it hold 99 % of dance and ball games (102 to 124)
    push_sd_m_s2: float = 40.0  # measured
    # m/s², a foot that hits the floor or a ball; 99.9 % of the samples of the hardest takes recorded are below 280
    max_impact_m_s2: float = 600.0  # physical
    fastest_m_s: float = 15.0  # physical: m/s, of any marker: a hand goes 10 where it strikes and 15 where it throws
    # m, standard deviation by which skin lets a marker move against its bone, as markers of recorded actors do on a
    # fitted body
    skin_m: float = 0.006  # measured
    limb_m: float = 0.5  # physical: m, no marker is farther from the next one of its own limb, a hand's from an elbow's
    trunk_m: float = 0.4  # physical: m, how wide a chest or a pelvis is, and how near to each other two people stand
    # m, standard deviation of where people put a marker or a plate on by hand, by what they feel of the bone
    placed_m: float = 0.015  # physical
    # m, standard deviation of a distance between markers from lab to lab, and of where a plate is on a limb; with 2 cm
    # plates of other people that are turned round are worth more than the truth
    lab_m: float = 0.04  # measured
    # px, standard deviation of blobs about where calibrations have them, 0.3 to 0.6 in rooms
    noise_px: float = 0.5  # measured
    # m, standard deviation of a point that was reconstructed, beside its motion: blobs that merge or are partly
    # hidden, and rays that come and go, and of a blob at its distance; with 4 mm as reach trajectories break
    noise_m: float = 0.003  # measured

    @property
    def max_push_m_s2(self) -> float:
        """How hard a marker's velocity changes at most where nothing is hit, m/s²."""
        return SIGMAS * self.push_sd_m_s2

    @property
    def max_noise_m(self) -> float:
        """How far a reconstructed point is off at most, m."""
        return SIGMAS * self.noise_m

    def reach_m(self, seconds: np.ndarray) -> np.ndarray:
        """How far from where it leads by its velocity a marker is seen at most after some time, m."""
        return self.max_noise_m + self.max_push_m_s2 / 2 * seconds**2


MARKER_LIMITS = MarkerLimits()


def possible_height(height: np.ndarray | float) -> np.ndarray:
    """Heights, m, or the nearest that people have."""
    return np.clip(height, *HEIGHTS_M)
