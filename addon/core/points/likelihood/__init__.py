# SPDX-License-Identifier: GPL-3.0-or-later
"""Naming clouds of anonymous 3D points frame by frame, by likelihood: learned from labelled takes of any marker set."""

from .calibration import Calibration
from .frames import label_frames
from .learn import learn_likelihood
from .model import Likelihood

__all__ = ["Calibration", "Likelihood", "label_frames", "learn_likelihood"]
