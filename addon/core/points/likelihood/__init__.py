# SPDX-License-Identifier: GPL-3.0-or-later
"""Naming clouds of anonymous 3D points frame by frame, by likelihood: learned from labelled takes of any marker set."""

from .labels import TARGET, Named, label_frames
from .learn import learn_likelihood
from .model import Calibration, Likelihood

__all__ = ["TARGET", "Evidence", "Named", "Trust", "label_frames", "learn_evidence"]
