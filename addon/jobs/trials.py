# SPDX-License-Identifier: GPL-3.0-or-later
"""Trials of a training as files, so that any process may try them."""

import json
from pathlib import Path

from threadpoolctl import threadpool_limits

from ..core.points.likelihood.trying import TrialOutcome, TrialWork, tried
from ..io.packed import pack, unpack
from ..io.scratch import naming_scratch
from ..io.source import read_bytes


def write_trial(path: Path, work: TrialWork):
    """Writes a trial to a scratch file."""
    with naming_scratch(path.parent):
        path.write_text(json.dumps(pack(work)), encoding="utf-8", newline="\n")


def try_file(path: Path, result: Path):
    """Tries the trial of a scratch file, as it would be tried in the process that wrote it; writes what comes of it."""
    work = unpack(TrialWork, json.loads(read_bytes(path)), "trial", path)
    with threadpool_limits(1, user_api="blas"):
        outcome = tried(work)
    with naming_scratch(result.parent):
        result.write_text(json.dumps(pack(outcome)), encoding="utf-8", newline="\n")


def outcome_of(answer: dict, path: Path) -> TrialOutcome:
    """What came of the trial of a scratch file, as `try_file` wrote it."""
    return unpack(TrialOutcome, answer, "trial", path)
