# SPDX-License-Identifier: GPL-3.0-or-later
"""Takes that a model is not for are refused with the reason; `--force` names them all the same."""

import pytest

from addon.demo.take import MODEL

from .conftest import report_of


@pytest.mark.parametrize("axis", ["x", "-y"])
def test_a_take_with_another_axis_up_says_which(run, room, tmp_path, axis):
    answer = run("label", room.c3d, "--model", MODEL, "--up", axis, "--out", tmp_path / "out")
    assert answer.refusal(1).endswith(
        f"stands with z up, as which it looks like a take of model {MODEL}; expected that axis to be given, by --up z; "
        "--force goes on regardless"
    )


def test_a_take_of_another_marker_set_says_which_and_is_named_where_it_is_forced(run, room, tmp_path):
    words = "label", room.c3d, "--model", "actor41", "--out", tmp_path / "out"
    reason = run(*words).refusal(1)
    assert "does not look like a take of model actor41" in reason
    assert reason.endswith(f"it looks like a take of {MODEL} or body39; --force goes on regardless")
    assert run(*words, "--force").status == 0
    assert report_of(tmp_path / "out" / f"{room.c3d.stem}.labels.csv")["model"] == "actor41"
