# SPDX-License-Identifier: GPL-3.0-or-later
"""What broken files have found in the readers and writers, a case each, and files that were cut off."""

import json
import re
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from addon.core.data.errors import MAX_LETTERS, InputError
from addon.core.data.takes import Points
from addon.io.cameras import read_cameras
from addon.io.markersets import read_markerset
from addon.io.points import read_points, write_c3d, write_trc
from addon.io.provenance import earlier_run, sealed
from addon.io.world import UNITS
from addon.jobs.training_takes import read_takes
from tests.fuzz.kinds import MADE, samples
from tests.io.checks import memory_within, refused
from tests.io.samples import motive, ring, walk, xcp


@pytest.fixture(scope="module")
def sound(tmp_path_factory):
    return samples(tmp_path_factory.mktemp("sound"))


def test_a_matrix_that_is_singular_in_the_image_and_a_principal_point_beyond_all_numbers_are_refused(sound, tmp_path):
    folder = shutil.copytree(sound["rad"].parent, tmp_path / "selfcal")
    lens = folder / sound["rad"].name
    text = re.sub(r"K11 = \S+", "K11 = 0", lens.read_text())
    lens.write_text(re.sub(r"K13 = \S+\n(.*\n)*?K31 = \S+", lambda found: found[0].rpartition("=")[0] + "= 1", text))
    refused("singular matrix", read_cameras, folder)
    path = tmp_path / "cameras.yml"
    text = re.sub("W_cam_1: .*\n", "", sound["yml"].read_text())
    path.write_text(re.sub(r"(K_cam_1:(?:.*\n){4}.* )\S+,", r"\g<1>1e308,", text))
    assert "1e308" in path.read_text()
    refused("camera cam_1 has a value that is not a number of any camera", read_cameras, path)


def test_a_projection_matrix_at_the_limit_of_numbers_is_refused(sound, tmp_path):
    folder = shutil.copytree(sound["pmat"].parent, tmp_path / "selfcal")
    rows = "0 0 167.343292413849e9 0\n0 1 -1597.90457586114 0\n2.31507038075396e-320 1 -0.522539554766117 1\n"
    (folder / sound["pmat"].name).write_text(rows)
    refused("no projection matrix", read_cameras, folder)


def test_a_point_at_the_centre_of_a_camera_has_no_image(sound):
    one = read_cameras(sound["toml"]).select([0])
    at_centre = replace(one, translation=np.array([[1.7, 2.1, 3.3e-320]]))
    assert np.isnan(at_centre.project(np.zeros((1, 3)))).all()


@pytest.mark.parametrize("value", ["1e-300", "1e-9", "0", "-1"])
@pytest.mark.parametrize("key", ["FOCAL_LENGTH", "PIXEL_ASPECT_RATIO"])
def test_a_focal_length_near_nought_is_refused(key, value, tmp_path):
    path = tmp_path / "a.xcp"
    path.write_text(re.sub(f'{key}="[^"]*"', f'{key}="{value}"', xcp(ring())))
    assert f'{key}="{value}"' in path.read_text()
    refused("no focal length", read_cameras, path)


def test_what_a_file_says_moves_no_cursor_and_fills_no_page(sound, tmp_path):
    document = json.loads(sound["markerset"].read_text())
    document["segments"][-1]["parent"] = "\x1b[2J\x85\u2028" + "x" * 100_000
    path = tmp_path / "a.markerset.json"
    path.write_text(json.dumps(document))
    with pytest.raises(InputError) as caught:
        read_markerset(path)
    said = str(caught.value)
    assert caught.value.message.isprintable()
    assert "; expected" in said and len(caught.value.message) <= MAX_LETTERS + 3
    assert len(said.splitlines()) == 1


@pytest.mark.parametrize("name", ["\x0c\x01D", "a\nb", "M\x1e", "a\tb", "c\u2028d"])
def test_names_with_line_ends_leave_the_rows_of_a_trc_whole(name, tmp_path):
    take = walk()
    path = tmp_path / "a.trc"
    write_trc(path, type(take)((name, *take.names[1:]), take.xyz, take.residual, take.rate, take.first_frame))
    assert len(read_points(path, everything=True, up="z").names) == len(take.names)


@pytest.mark.parametrize(
    "part",
    [
        *({"doubtful": {"M1": spans}} for spans in (3, [[33]], [["a", "b"]], [33, 34], [[1.5, 2]])),
        *({"filled": rows} for rows in (3, {"M1": 3}, [{"marker": "M1"}], [{"marker": [], "first": None, "last": 3}])),
    ],
)
def test_a_damaged_report_of_what_was_doubtful_is_refused_and_not_passed_over(part, sound, tmp_path):
    take = Path(shutil.copy(sound["report"].with_name("taught.c3d"), tmp_path))
    report = Path(shutil.copy(sound["report"], tmp_path))
    (learned,) = read_takes([take], [])
    assert learned.names
    report.write_text(json.dumps(json.loads(report.read_text()) | part))
    refused(r"taught\.report\.json: is damaged in what was doubtful", read_takes, [take], [])


def test_results_lie_beside_their_report_whatever_it_says_and_one_with_too_long_a_name_is_not_there(sound, tmp_path):
    report, document = tmp_path / sound["report"].name, json.loads(sound["report"].read_text())
    for ending in ("../taught.c3d", "a/b", "/", "9" * 5000):
        made = document["provenance"] | {"results": {ending: "ab"}}
        report.write_text(json.dumps(sealed(document | {"provenance": made})))
        if len(ending) < 5000:
            refused("does not say what it was made of", earlier_run, report, MADE)
    assert earlier_run(report, MADE)[1], "missing"


@pytest.mark.parametrize("count", ["999999999", "999999999999", "9" * 5000])
@pytest.mark.parametrize("field", ["NumMarkers", "NumFrames"])
def test_endless_counts_in_the_head_of_a_trc_take_no_memory(field, count, sound, tmp_path):
    lines = sound["trc"].read_text().splitlines()
    numbers = lines[2].split("\t")
    numbers[lines[1].split("\t").index(field)] = count
    path = tmp_path / "a.trc"
    path.write_text("\n".join([*lines[:2], "\t".join(numbers), *lines[3:]]) + "\n")
    with memory_within(50e6):
        try:
            read_points(path, everything=True)
        except InputError as error:
            assert "; expected" in error.message


@pytest.mark.parametrize(
    ("old", "new", "rate"),
    [
        ("Length Units", f"Total Exported Frames,{'9' * 5000},Length Units", 120.0),
        ("Export Frame Rate,", "Export Frame Rate,1e-320,Other,", 240.0),
    ],
)
def test_an_endless_count_or_a_rate_that_no_other_file_could_hold_is_passed_over(sound, tmp_path, old, new, rate):
    path = tmp_path / "a.csv"
    path.write_text(sound["motive"].read_text().replace(old, new, 1))
    assert (len(read_points(path).xyz), read_points(path).rate) == (5, rate)


@pytest.fixture
def whole(tmp_path):
    """A take as C3D, TRC and Motive CSV."""
    take = walk(frames=40)
    write_c3d(tmp_path / "take.c3d", take)
    write_trc(tmp_path / "take.trc", take)
    text = motive().replace("Length Units", "Total Exported Frames,5,Length Units")
    (tmp_path / "take.csv").write_text(text, encoding="utf-8")
    for path in tmp_path.iterdir():
        assert len(read_points(path).xyz) in (5, 40)
    return tmp_path


def test_a_c3d_that_ends_within_its_parameters_is_called_cut_off(tmp_path):
    path, names = tmp_path / "many.c3d", tuple(f"a long name {number}" for number in range(200))
    write_c3d(path, Points(names, np.ones((2, 200, 3)), np.zeros((2, 200)), 100.0, 1))
    content = path.read_bytes()
    for left in range(1030, 3000, 100):
        path.write_bytes(content[:left])
        refused("has parameters that are cut off; expected a C3D file", read_points, path)


@pytest.mark.parametrize("name", ["take.c3d", "take.trc", "take.csv"])
@pytest.mark.parametrize("left", [0.45, 0.6, 0.8, 0.9])
def test_what_is_cut_off_anywhere_is_refused(whole, name, left):
    content = (whole / name).read_bytes()
    (whole / name).write_bytes(content[: int(left * len(content))])
    refused("expected", read_points, whole / name)


def test_a_motive_export_with_fewer_frames_than_it_says_is_whole_unless_its_last_line_may_be_cut(whole):
    """Motive has counted 30,000 too many in exports of long takes."""
    lines = (whole / "take.csv").read_text(encoding="utf-8").splitlines(keepends=True)
    (whole / "take.csv").write_text("".join(lines[:-2]), encoding="utf-8")
    take = read_points(whole / "take.csv", up="y")
    assert (len(take.xyz), take.notes) == (3, ("has 3 of 5 frames that its head counts",))
    (whole / "take.csv").write_text("".join(lines[:-2])[:-1], encoding="utf-8")
    refused("has 3 of 5 frames .* or without a line end", read_points, whole / "take.csv")


@pytest.mark.parametrize(("begin", "end"), [(10, 40), (0, 30), (5, 35)])
def test_a_part_that_was_taken_out_of_a_trc_is_no_damage(whole, begin, end):
    lines = (whole / "take.trc").read_text().splitlines(keepends=True)
    (whole / "take.trc").write_text("".join([*lines[:6], *lines[6 + begin : 6 + end]]))
    take = read_points(whole / "take.trc")
    assert (len(take.xyz), take.first_frame) == (30, walk().first_frame + begin)
    assert take.notes == ("has 30 of 40 frames that its head counts",)


def test_a_trc_whose_last_line_has_no_end_is_whole_unless_it_lacks_fields_or_frames(whole):
    path, text = whole / "take.trc", (whole / "take.trc").read_text()
    path.write_text(text.removesuffix("\n"))
    assert (len(read_points(path).xyz), read_points(path).notes) == (40, ())
    head, rows = text.splitlines()[:6], text.splitlines()[6:]
    uncounted = "\n".join(head).replace("\t40\t", "\t1\t")
    for cut, words in (
        (text[: text.rindex("\t")], "ends in the middle of a row; expected 14 fields"),
        ("\n".join([*head, *rows[:20]])[:-2], "has 20 of 40 frames .* ends in the middle of a row or without"),
        ("\n".join([uncounted, rows[0][: rows[0].rindex("\t")]]), "ends in the middle of a row; expected 14 fields"),
    ):
        path.write_text(cut)
        refused(words, read_points, path)


def test_a_trc_keeps_frames_below_nought(tmp_path):
    take = walk()
    write_trc(tmp_path / "early.trc", Points(take.names, take.xyz, take.residual, take.rate, -7))
    assert read_points(tmp_path / "early.trc").first_frame == -7


@pytest.mark.parametrize("unit", ["m", "cm", "mm", "", "furlongs"])
def test_a_unit_that_no_file_names_is_assumed_and_said(tmp_path, unit):
    person = walk(frames=20, points=20)
    write_trc(tmp_path / "take.trc", person)
    text = (tmp_path / "take.trc").read_text()
    # A reader that splits a head at white space needs a word there.
    (tmp_path / "take.trc").write_text(re.sub(r"\tmm\t", f"\t{unit or '?'}\t", text, count=1))
    take = read_points(tmp_path / "take.trc")
    assert take.assumed == ("" if unit in UNITS else "mm")
    if unit not in ("m", "cm"):
        np.testing.assert_allclose(take.xyz, person.xyz, atol=1e-5)
