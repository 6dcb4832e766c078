# SPDX-License-Identifier: GPL-3.0-or-later
"""A person's way through the sidebar of a real Blender's window; `tours/sidebar.py` walks it, this file judges it."""

import pytest

pytestmark = [pytest.mark.real_blender, pytest.mark.window, pytest.mark.slow]


@pytest.fixture(scope="module")
def tour(watch, virtual_take, tmp_path_factory):
    folder = tmp_path_factory.mktemp("tour")
    task = {
        "cameras": str(virtual_take / "cameras.toml"),
        "blobs": str(virtual_take / "take.csv"),
        "markerset": "body26",
    }
    return watch("sidebar", folder, **task)


def test_the_steps_stand_in_order_from_the_start(tour):
    order = ["import_cameras", "import_blobs", "label"]
    shown = [name.removeprefix("mocap_autolabel.") for name in tour["at first"]]
    assert [name for name in shown if name in order] == order


def test_a_click_starts_labelling_and_esc_leaves_nothing(tour):
    assert tour["running after the click"]
    assert tour["after Esc"] == {"running": False, "take": False, "actions": 0}


def test_a_click_labels_the_take_and_offers_the_review(tour):
    assert tour["labelled"]
    assert "mocap_autolabel.clear" in tour["to review"]


def test_a_click_looks_through_a_camera(tour):
    assert tour["view"] == "CAMERA"
