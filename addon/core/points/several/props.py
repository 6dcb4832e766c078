# SPDX-License-Identifier: GPL-3.0-or-later
"""Props: what is one rigid body is known by its form, in anybody's hand, before people are parted."""

from dataclasses import replace

import numpy as np

from ...data.errors import JobError
from ...data.progress import Stage
from ..models import Model
from ..refusals import UnsuitedError
from ..whole_take.pipeline import Steps, name_frames
from .bodies import Crowd, NamedBody
from .together import FoundSubject, verdict_on
from .wearers import Wearer


def is_prop(model: Model) -> bool:
    """Whether all markers of a set are on one rigid body."""
    bodies = model.rigid_bodies
    return bodies is not None and len(bodies.members) == 1 and len(bodies.members[0]) == len(model.markerset)


def found_prop(crowd: Crowd, prop: Wearer) -> Steps[FoundSubject]:
    """A prop named among everything else, with its tracklets; JobError where it is not there."""
    # A body's parts are rigid, too: what a take shows of them must not be learned as the prop's form.
    model = replace(prop.model, training_takes=())
    try:
        frames = yield from name_frames(crowd.take, crowd.tracklet, model, crowd.options)
        yield Stage("vote", f"look where {prop.name} is")
        body = NamedBody(prop.model, frames, None)
        verdict = verdict_on(body, crowd.options.target)
    except UnsuitedError:
        words = f"shows no {prop.name}, or not often enough to know it by the form of {prop.model.markerset.name}"
        raise JobError(f"{words}; expected a take with that prop, so leave it out") from None
    own = 2 * crowd.count(verdict.labels.named) > np.maximum(crowd.size, 1)
    labels = verdict.labels.kept(crowd.tracklets_of(own) >= 0)
    return FoundSubject(prop, body, own, replace(verdict, labels=labels))
