# SPDX-License-Identifier: GPL-3.0-or-later
"""Takes as they go wrong: cameras that drop out, people who come and go, hints that age, ghosts in crowds."""

import numpy as np
import pytest

from addon.core.blobs import pipeline
from addon.core.blobs.pipeline import Options, label_take
from addon.core.blobs.search import Hints
from addon.core.simulation.rigs import paper_rig
from addon.core.simulation.virtual import Act
from tests.core.blobs.test_pipeline import RIG, ROOM, Outcome, walk
from tests.core.scenes import act, blobs_at, built_in


@pytest.mark.parametrize("name", ["gait15", "body26"])
@pytest.mark.parametrize(("gap", "start"), [(1, 20), (2, 40), (5, 60)])
def test_a_short_dropout_of_all_cameras_exchanges_no_names(name, gap, start):
    frame = walk(name).blobs.frame
    whole = Outcome(walk(name), (frame < start) | (frame >= start + gap))
    assert whole.wrong <= 2 and whole.right.mean() > 0.995


def long_walk():
    return act(
        built_in("gait15"),
        RIG,
        [Act(0.3), Act(1.5, stride=0.9), Act(1.2, stride=0.4, turn=np.pi), Act(1.5)],
        seed=3,
        options=ROOM,
    )


def test_every_frame_without_a_subject_is_in_a_suspect():
    scene = long_walk()
    whole = Outcome(scene, scene.blobs.frame >= 70)
    covered = np.zeros(len(scene.blobs.frames), dtype=bool)
    for suspect in whole.suspects:
        covered |= (scene.blobs.frames >= suspect.first) & (scene.blobs.frames <= suspect.last)
    assert covered[~whole.found].all()


def test_a_short_visit_in_a_long_chunk_is_found():
    scene = long_walk()
    frame = scene.blobs.frame
    whole = Outcome(scene, (frame >= 145) & (frame < 165))
    assert whole.right.mean() > 0.9


def test_a_facing_hint_is_for_the_beginning_only():
    scene = long_walk()
    frame = scene.blobs.frame
    whole = Outcome(scene, (frame < 150) | (frame >= 200), options=Options(Hints(None, 0.0)))
    assert whole.wrong <= 5


def test_markers_without_labels_have_no_points(monkeypatch):
    scene = walk()

    def doubt(_, markers):
        sure = np.ones(markers)
        sure[3] = 0.4
        return sure

    monkeypatch.setattr(pipeline, "swap_doubts", doubt)
    whole = Outcome(scene, scene.blobs.frame < 20)
    assert not (whole.marker == 3).any()
    assert np.isnan(whole.chunks[0].motion.markers[:20, 3]).all()


def test_twelve_frames_a_second():
    acts = [Act(0.3), Act(1.5, stride=1.0), Act(1.0, stride=0.6, turn=np.pi)]
    scene = act(built_in("gait15"), RIG, acts, seed=4, options=ROOM, rate=12)
    chunks = list(label_take([scene.blobs], RIG, scene.markerset, 12.0))
    names = scene.names(chunks[0].labels.marker)
    given = chunks[0].labels.marker >= 0
    assert (given & ~scene.right(names)).sum() <= 0.005 * given.sum()


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("count", [60, 100])
def test_many_ghosts_are_nobody(seed, count):
    rig = paper_rig()
    px = [np.random.default_rng([seed, c]).uniform([0, 0], rig.size[0], (count, 2)) for c in range(4)]
    (chunk,) = label_take([blobs_at(px)], rig, built_in("body26"))
    assert (chunk.labels.marker < 0).all()
