# SPDX-License-Identifier: GPL-3.0-or-later
"""Bone maps of other add-ons; whatever else is in a file is no map."""

import pytest

from addon.core.data.errors import InputError
from addon.io.bone_maps import read_bone_map


def test_bones_without_a_partner_are_left_out(tmp_path):
    path = tmp_path / "a.bmap"
    path.write_bytes(b"c_head.x%False%\r\nHead\r\nFalse\r\nFalse\r\n\r\nNone%False%\r\nEnd\r\nFalse\r\nFalse\r\n")
    assert read_bone_map(path) == {"Head": "c_head.x"}


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("a.json", "[]"),
        ("a.json", '{"bones": 3}'),
        ("a.json", '{"bones": [1, {"SourceBoneName": ["a"], "DestinationBoneName": "b"}]}'),
        ("a.bmap", "one\n\n\n\n"),
    ],
)
def test_what_maps_nothing_is_refused(tmp_path, name, text):
    (tmp_path / name).write_text(text)
    with pytest.raises(InputError, match=r"maps no bones; expected a \.bmap"):
        read_bone_map(tmp_path / name)
