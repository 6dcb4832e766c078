# SPDX-License-Identifier: GPL-3.0-or-later
"""The stages that the ablation switches off: what stands in the place of each is called as it is."""

import inspect
from pkgutil import resolve_name

import pytest

from tests.accuracy.switches import CORE, STAGES


@pytest.mark.parametrize(("where", "instead"), [item for stage in STAGES.values() for item in stage.items()])
def test_what_stands_in_the_place_of_a_stage_takes_what_the_stage_does(where, instead):
    whole = resolve_name(f"{CORE}.{where}")
    given = inspect.signature(whole).parameters.values()
    by_name = {one.name: one.default for one in given if one.kind is one.KEYWORD_ONLY}
    by_place = [one.name for one in given if one.kind in (one.POSITIONAL_ONLY, one.POSITIONAL_OR_KEYWORD)]
    inspect.signature(instead).bind(*by_place, **by_name)
