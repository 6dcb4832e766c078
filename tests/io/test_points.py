# SPDX-License-Identifier: GPL-3.0-or-later
"""Takes of 3D points, of every program and of thousands of short trajectories, judged by other readers."""

import re
import warnings
from dataclasses import replace

import numpy as np
import pytest

from addon.core.data.columns import Columns, beside_of
from addon.core.data.errors import InputError
from addon.core.data.lanes import Lanes
from addon.core.data.takes import Points
from addon.io.c3d.lab import read_lab
from addon.io.c3d.writing import write_c3d_file
from addon.io.points import holds_points, marker_columns, read_points, write_c3d, write_trc
from addon.io.textpoints import read_trc
from addon.io.whole import whole_file
from addon.io.world import SIGNED_AXES, UNSURE_WORDS, find_up, guess_unit, up_rotation
from tests import recorded
from tests.accuracy.people import BODY26
from tests.io.c3d_layouts import Layout, dense, read_c3d
from tests.io.checks import memory_within, refused
from tests.io.samples import BLOBS, motive, tsv, vicon, walk

ezc3d = pytest.importorskip("ezc3d")
py_c3d = pytest.importorskip("c3d")


def by_ezc3d(path):
    """Names, xyz (T, P, 3) and residual (T, P) in the file's units, NaN where missing, rate, first frame."""
    take = ezc3d.c3d(str(path))
    point = take["parameters"]["POINT"]
    labels = [label for key in sorted(point) if re.fullmatch(r"LABELS\d*", key) for label in point[key]["value"]]
    xyz = take["data"]["points"][:3].transpose(2, 1, 0).copy()
    residual = take["data"]["meta_points"]["residuals"][0].T.copy()
    missing = (residual < 0) | ~np.isfinite(xyz).all(axis=2) | (xyz == 0).all(axis=2)
    xyz[missing], residual[missing] = np.nan, np.nan
    return labels, xyz, residual, take["header"]["points"]["frame_rate"], take["header"]["points"]["first_frame"] + 1


def by_py_c3d(path):
    with warnings.catch_warnings(), path.open("rb") as file:
        warnings.simplefilter("ignore")
        reader = py_c3d.Reader(file)
        frames = np.array([points for _, points, _ in reader.read_frames(check_nan=False)])
        xyz = frames[..., :3].astype(float)
        xyz[frames[..., 3] < 0] = np.nan
        residual = np.where(np.isfinite(xyz).all(axis=2) & (xyz != 0).any(axis=2), frames[..., 3], np.nan)
        return [label.strip() for label in reader.point_labels], xyz, residual, reader.first_frame, reader.last_frame


def test_what_is_written_is_read_by_every_reader(tmp_path):
    take, path = walk(), tmp_path / "take.c3d"
    write_c3d(path, take)
    for labels, xyz in (by_ezc3d(path)[:2], by_py_c3d(path)[:2]):
        assert labels == ["*1", "M1", "M2", "M3"]
        np.testing.assert_allclose(xyz, take.xyz * 1000, atol=1e-3)
    assert by_ezc3d(path)[3:] == (120.0, 33)
    assert by_py_c3d(path)[3:] == (33, 38)
    residual = by_py_c3d(path)[2]
    np.testing.assert_allclose(residual[np.isfinite(residual)], 0.5, atol=0.026)
    found = read_points(path)
    assert (found.names, found.rate, found.first_frame) == (take.names, take.rate, take.first_frame)
    np.testing.assert_allclose(found.xyz, take.xyz, atol=1e-6)
    np.testing.assert_allclose(found.residual, take.residual, atol=2.6e-5)
    assert ezc3d.c3d(str(path))["parameters"]["POINT"]["UNITS"]["value"] == ["mm"]
    content, missing = path.read_bytes(), np.isnan(take.xyz[..., 0])
    words = np.frombuffer(content[512 * (1 + content[514]) :], "<f4")[: 6 * 4 * 4].reshape(6, 4, 4)
    assert np.isnan(words[missing, :3]).all()
    np.testing.assert_array_equal(words[..., 3] == -1, missing)


@pytest.mark.parametrize(("frames", "points", "first"), [(70001, 2, 5), (3, 600, 70000), (65535, 1, 1), (65536, 1, 0)])
def test_long_and_wide_takes(tmp_path, frames, points, first):
    xyz = np.random.default_rng(0).normal(size=(frames, points, 3)).astype(np.float32).astype(float)
    path = tmp_path / "take.c3d"
    names = tuple(f"a long name of marker {index}" for index in range(points))
    write_c3d(path, Points(names, xyz, np.full((frames, points), np.nan), 59.94, first))
    found = read_points(path)
    assert (found.names, found.first_frame, found.rate) == (names, first, 59.94)
    np.testing.assert_allclose(found.xyz, xyz, atol=1e-6)
    labels, other, *_ = by_ezc3d(path)
    assert labels == list(names)
    np.testing.assert_allclose(other, xyz * 1000, atol=1e-3)


def test_too_many_points_are_refused(tmp_path):
    with pytest.raises(InputError, match="16320 points"):
        write_c3d_file(tmp_path / "a.c3d", ["a"] * 16321, np.zeros((1, 16321, 3)), np.zeros((1, 16321)), 100, 1)
    with pytest.raises(InputError, match="more names than"):
        write_c3d_file(tmp_path / "a.c3d", ["a" * 200] * 800, np.ones((1, 800, 3)), np.zeros((1, 800)), 100, 1)


def test_real_files_are_read_as_ezc3d_reads_them(shared_data):
    folders = (recorded.TENNIS, recorded.GAPS, "rooms/vicon12")
    one = shared_data / "people" / "mcgill" / "HC030A" / "HC030A05.c3d"
    for path in (one, *recorded.takes(shared_data, *folders, kinds=(".c3d",))):
        take = read_c3d(path)
        labels, xyz, _, rate, first = by_ezc3d(path)
        assert take.labels == labels, path.name
        assert (take.rate, take.first_frame) == (pytest.approx(rate), first), path.name
        np.testing.assert_array_equal(take.xyz, xyz)
    # ezc3d takes the residual from other bits than the format's guide says; py-c3d reads them as we do.
    doubled = shared_data / "people" / "tennis" / "duplicate_labels.c3d"
    assert np.nanmax(read_c3d(doubled).residual) > 1
    np.testing.assert_allclose(read_c3d(doubled).residual, by_py_c3d(doubled)[2], rtol=1e-5)


MARKERS = (*BODY26, "LTHI", "RTHI", "LTIB", "RTIB")


def test_model_outputs_are_told_from_markers(shared_data):
    for path in recorded.takes(shared_data, *recorded.MCGILL):
        take, labels = read_points(path), read_c3d(path).labels
        assert 50 < len(take.names) < 90, f"{path.name}: {take.names}"
        present = marker_columns(take.names, MARKERS, path)
        lost = [name for name, column in zip(MARKERS, present, strict=True) if column < 0]
        assert not set(lost) & set(labels), f"{path.name} lost {lost}"
        assert len(lost) <= 1, f"{path.name} has no {lost}"
        assert not any("Angle" in name or "Force" in name or "JC" in name for name in take.names)
        first = [(name, index) for name, index in zip(take.names, take.columns, strict=True) if index < 20]
        assert first == [(labels[index], index) for _, index in first]
        # People stand on the floor and are no taller than 2 m.
        height = take.xyz[:, present[present >= 0], 2]
        assert np.nanmin(height) > -0.05
        assert 1.0 < np.nanmax(height) < 2.1, path.name
        assert len(read_points(path, everything=True).names) == len(labels)


def test_axes_and_centres_are_no_markers_those_behind_a_subject_are_and_doubles_are_told(tmp_path):
    names = ["PELO", "PELA", "PELL", "PELP", "LTIO", "LASI", "LHJC", "Ann:RKJC", "CentreOfMass", "LTIB", "LTIB1", "T10"]
    xyz = np.ones((3, len(names), 3)) * np.linspace(0.1, 1.5, len(names))[:, None]
    write_c3d(tmp_path / "a.c3d", Points(tuple(names), xyz, np.zeros((3, len(names))), 100, 1))
    take = read_points(tmp_path / "a.c3d")
    assert take.names == ("LTIO", "LASI", "LTIB", "LTIB1", "T10")
    assert take.columns.tolist() == [4, 5, 9, 10, 11]
    assert marker_columns(["Ann:LASI", "", "RASI"], ["LASI", "RASI", "SACR"]).tolist() == [0, 2, -1]
    assert marker_columns(["Ann:LASI", "Bob:LASI"], ["Bob:LASI"]).tolist() == [1]
    assert marker_columns(["LASI", "Bob:LASI"], ["LASI"]).tolist() == [0]
    names = [f"{who}:LASI" for who in ("Ann", "Bob", "Cy", "Di")]
    refused(r"has 4 subjects for marker LASI \(.*Cy:LASI, Di:LASI", marker_columns, names, ["LASI"], "take.c3d")
    refused("the label twice", marker_columns, ["LASI", "LASI"], ["LASI"])


def test_raw_takes_have_no_names(shared_data):
    raw = read_points(shared_data / "people" / "clouthier" / "S09_KneeltoRun02.c3d")
    assert set(raw.names) == {""}
    assert len(raw.names) == 75
    export = read_points(shared_data / "exports" / "motive_unlabeled.csv")
    assert set(export.names) == {""}
    assert (len(export.xyz), export.rate, export.first_frame) == (1353, 360.0, 0)


PERSON, FOUR = walk(points=20), walk(points=4)
TRC_TAKES = {
    "as it is": walk(),
    "somebody who lies": replace(PERSON, names=("",) * 20, xyz=PERSON.xyz[..., [2, 0, 1]] + [0, 0, 0.1]),
    "markers called after axes": replace(walk(points=3), names=("RX", "RY", "RZ")),
    "a last marker that is never there": replace(FOUR, xyz=np.where(np.arange(4)[:, None] == 3, np.nan, FOUR.xyz)),
}


@pytest.mark.parametrize("name", TRC_TAKES)
def test_our_own_trc_comes_back(tmp_path, name):
    take = TRC_TAKES[name]
    write_trc(tmp_path / "take.trc", take)
    found = read_points(tmp_path / "take.trc")
    assert (found.names, found.rate, found.first_frame) == (take.names, take.rate, take.first_frame)
    np.testing.assert_allclose(found.xyz, take.xyz, atol=1e-8)


@pytest.mark.parametrize(("unit", "metre"), [("mm", 1e-3), ("Meters", 1.0), ("ft", 0.3048)])
def test_the_trc_of_a_trc_has_its_head_and_time_in_mm_with_z_up(tmp_path, unit, metre):
    take, path, out = walk(first=200), tmp_path / "own.trc", tmp_path / "named.trc"
    write_trc(path, take)
    lines = path.read_text().splitlines()
    lines[:3] = [
        "PathFileType\t4\t(x/y/z)\tlab.trc",
        "DataRate\tCameraRate\tNumFrames\tNumMarkers\tUnits\tOrigDataRate\tOrigDataStartFrame\tOrigNumFrames\tLab",
        f"120.00\t240.0\t6\t4\t{unit}\t240.0\t17\t9000\tB",
    ]
    for number, points in enumerate(take.xyz[..., [1, 2, 0]] / metre):  # y up
        texts = ["" if value != value else f"{value:.9f}" for value in points.ravel()]
        lines[6 + number] = "\t".join([f"{200 + number}", f"{2.5 + number / 120:.6f}", *texts])
    path.write_text("\n".join([*lines, ""]))
    part = read_points(path, frames=(202, 205))
    write_trc(out, part, part.trial)
    written, head = out.read_text().splitlines(), lines[2].split("\t")
    assert written[1] == lines[1]
    head[2], head[4] = "4", "mm"
    assert written[2].split("\t") == head
    own = [row.split("\t") for row in (lines[8], written[6])]
    assert [row[:2] for row in own] == [["202", "2.516667"]] * 2
    again = read_points(out)
    assert (again.up, again.rate, again.first_frame) == ("+Z", 120, 202)
    np.testing.assert_allclose(again.xyz, part.xyz, atol=1e-8)
    write_c3d(tmp_path / "named.c3d", part, part.trial)
    parameters = ezc3d.c3d(str(tmp_path / "named.c3d"))["parameters"]
    assert parameters["TRIAL"]["CAMERA_RATE"]["value"] == 240


TRC = (
    "PathFileType\t4\t(X/Y/Z)\ta.trc\nDataRate\tCameraRate\tNumFrames\tNumMarkers\tUnits\n"
    "{rate}\t100\t1\t1\tmm\nFrame#\tTime\tA\t\t\n\t\tX1\tY1\tZ1\n{rows}"
)

TRC_HEADS = {
    "three tabs a name": "Frame#\tTime\tA\t\t\tB b\t\t\tC\t\t\n\t\tX1\tY1\tZ1\tX2\tY2\tZ2\tX3\tY3\tZ3\n\n",
    "three tabs and more behind": "Frame#\tTime\tA\t\t\tB b\t\t\tC\t\t\t\t\n\t\tX1\tY1\tZ1\t\n\n",
    "one tab a name": "Frame#\tTime\tA\tB b\tC\n\t\tX1\tY1\tZ1\tX2\tY2\tZ2\tX3\tY3\tZ3\n\n",
    "one tab and no empty line": "Frame#\tTime\tA\tB b\tC\t\n\t\tX1\tY1\tZ1\tX2\tY2\tZ2\tX3\tY3\tZ3\n",
    "two tabs a name": "Frame#\tTime\tA\t\tB b\t\tC\t\t\n\tX1\tY1\tZ1\tX2\tY2\tZ2\tX3\tY3\tZ3\n\n",
    "now one tab, now two": "Frame#\tTime\tA\tB b\t\tC\n\t\tX1\tY1\tZ1\tX2\tY2\tZ2\tX3\tY3\tZ3\n\n",
    "four tabs a name": "Frame#\tTime\tA\t\t\t\tB b\t\t\t\tC\n\t\tX1\tY1\tZ1\tX2\tY2\tZ2\tX3\tY3\tZ3\n\n",
    "a space before the first": "Frame#\tTime A\t\t\tB b\t\t\tC\t\t\t\n\t\tX1\tY1\tZ1\n\n",
    "a name a column": "Frame#\tTime\tA_x\tA_y\tA_z\tB b.X\tB b.Y\tB b.Z\tCX\tCY\tCZ\n",
    "a name a column and axes": "Frame#\tTime\tA_x\tA_y\tA_z\tB b x\tB b y\tB b z\tCx\tCy\tCz\n\t\tX1\tY1\tZ1\n\n",
}


@pytest.mark.parametrize("head", TRC_HEADS)
@pytest.mark.parametrize("promised", ["3", "", "2"])
def test_trc_heads_of_other_programs(tmp_path, head, promised):
    """OpenSim's, AddBiomechanics' and others' heads: the names stand for the same nine columns."""
    keys = "DataRate\tCameraRate\tNumFrames\tUnits\tOrigDataRate\tOrigDataStartFrame\tOrigNumFrames"
    values = "100\t100\t2\tmm\t100\t1\t2"
    if promised:
        keys, values = f"{keys}\tNumMarkers", f"{values}\t{promised}"
    path = tmp_path / "take.trc"
    rows = "1\t0.0\t1\t2\t3\t4\t5\t6\t7\t8\t9\n2\t0.01\t1\t2\t3\t\t\t\t7\t8\t9\t\n"
    path.write_text(f"PathFileType\t4\t(X/Y/Z)\ta.trc\n{keys}\n{values}\n{TRC_HEADS[head]}{rows}")
    take = read_trc(path)
    assert take.labels == ["A", "B b", "C"]
    assert take.first_frame == 1
    xyz, _ = dense(take.frames, 3, take.parts())
    np.testing.assert_array_equal(xyz[0], np.arange(1, 10).reshape(3, 3))
    np.testing.assert_array_equal(np.isnan(xyz[1, :, 0]), [False, True, False])
    if promised == "3":  # and with two points more, which nobody named
        path.write_text(path.read_text().replace("7\t8\t9", "7\t8\t9\t1\t1\t1\t2\t2\t2", 1).rstrip())
        assert read_trc(path).labels == ["A", "B b", "C", "", ""]


def _padded(text: str) -> str:
    """With nothing but spaces between the names, and a tab before each row."""
    lines = text.splitlines()
    names = "            ".join(name for name in lines[3].split("\t")[2:] if name)
    lines[3:] = ["Frame#\tTime" + " " * 12 + names, *("\t" + line for line in lines[4:])]
    return "\n".join(lines) + "\n"


WRITTEN = {
    "padded rows": _padded,
    "padded names": lambda text: text.replace("Frame#", "\tFrame#"),
    "nothing above frame and time": lambda text: text.replace("Frame#\tTime", "\t"),
    "a spreadsheet's": lambda text: text.replace("\t", ","),
    "a spreadsheet's in quotes": lambda text: re.sub(r"([^\t\n]+)", r'"\1"', text).replace("\t", ","),
}


@pytest.mark.parametrize("kind", WRITTEN)
def test_a_trc_need_not_have_tabs_where_the_format_has_them(tmp_path, kind):
    path = tmp_path / "take.trc"
    write_trc(path, walk())
    path.write_text(WRITTEN[kind](path.read_text()))
    found = read_points(path)
    assert (found.names, found.notes) == (walk().names, ())
    np.testing.assert_allclose(found.xyz, walk().xyz, atol=1e-7)


@pytest.mark.parametrize("named", [0, 2])
def test_a_trc_holds_points_without_a_name_behind_those_with_one(tmp_path, named):
    """EVaRT and Cortex write what they did not identify into further columns that the head does not know."""
    take, path = walk(), tmp_path / "take.trc"
    xyz = take.xyz.copy()
    xyz[0, 1:] = np.nan  # rows end where their last point does
    write_trc(path, Points(take.names, xyz, take.residual, take.rate, take.first_frame))
    lines = [line.rstrip("\t") + "\t" for line in path.read_text().splitlines()]
    lines[3] = "\t".join(["Frame#", "Time", *(f"{name}\t\t" for name in take.names[:named])])
    lines[4] = "\t" * (2 + 3 * named)
    path.write_text("\n".join(lines) + "\n")
    found = read_points(path)
    assert found.names == (*take.names[:named], *[""] * (len(take.names) - named))
    np.testing.assert_allclose(found.xyz, xyz, atol=1e-7)
    path.write_text("\n".join(lines) + "1.5\n")
    refused("and three for each point more", read_points, path)


@pytest.mark.parametrize("kind", ["Marker", "Unlabeled Marker"])
def test_motive_export(tmp_path, kind):
    path = tmp_path / "take.csv"
    path.write_text(motive().replace(",Marker" * 3 + "\n", f",{kind}" * 3 + "\n"), encoding="utf-8")
    take = read_points(path)
    assert take.names == ("Ann:LASI", "")
    assert (take.rate, take.first_frame) == (120, 0)
    # x stays, the height comes third, what was towards the viewer comes second with its sign changed.
    np.testing.assert_allclose(take.xyz[0], [[0.1, 0.2, 1.0], [0.011, -0.033, 0.022]])
    assert np.isnan(take.xyz[2, 0]).all()
    write_c3d(tmp_path / "named.c3d", take, take.trial)
    parameters = ezc3d.c3d(str(tmp_path / "named.c3d"))["parameters"]
    assert parameters["TRIAL"]["CAMERA_RATE"]["value"] == 240
    own = {name: row["value"] for name, row in parameters["MOTIVE"].items() if not name.startswith("__")}
    assert own == {"TAKE_NAME": ["test"], "CAPTURE_FRAME_RATE": ["240.000000"]}
    write_trc(tmp_path / "named.trc", take, take.trial)
    said = (tmp_path / "named.trc").read_text().splitlines()[2].split("\t")
    assert said == ["120", "240.000000", "5", "2", "mm", "240.000000", "0", "5"]


def test_a_motive_export_whose_rows_have_no_titles_is_read_as_one_with_them(tmp_path):
    """Motive 1's, whose points without names are also called otherwise."""
    path, text = tmp_path / "take.csv", motive().replace("Unlabeled 1036", "Unlabeled:1036")
    for title in ("Type", "Name", "ID", "Parent"):
        text = text.replace(f"\n,{title},", "\n,,")
    path.write_text(text)
    take = read_points(path)
    assert take.names == ("Ann:LASI", "")
    np.testing.assert_allclose(take.xyz[0], [[0.1, 0.2, 1.0], [0.011, -0.033, 0.022]])


def test_what_programs_call_points_that_nobody_named_is_no_name(tmp_path):
    names = "A", "New 0000", "New 12345", "Unidentified 3", "unlabeled_7", "*12", "U*7", "New foot", "New 12", "U1"
    write_c3d_file(tmp_path / "a.c3d", names, np.ones((2, len(names), 3)), np.zeros((2, len(names))), 100.0, 1)
    found = read_points(tmp_path / "a.c3d").names
    assert [name for name in found if name] == ["A", "New foot", "New 12", "U1"]


@pytest.mark.parametrize("sheet", [True, False])  # as a spreadsheet saves it, which fills up rows with commas
def test_vicon_export(tmp_path, sheet):
    path, text = tmp_path / "take.csv", vicon()
    if sheet:
        text = "".join(line + "," * (10 - line.count(",")) + "\r\n" for line in text.splitlines())
    path.write_text("\n\n" * sheet + text, encoding="utf-8-sig")
    take = read_points(path)
    assert (take.names, take.rate, take.first_frame, take.up) == (("Ann:LASI", ""), 100, 10, "+Z")
    np.testing.assert_allclose(take.xyz[0], [[0.11, 0.21, 1.0005], [0.011, 0.022, 0.033]])
    assert np.isnan(take.xyz[:, 0, 0]).tolist() == [False, False, True, False, False]


def test_vicon_exports_without_units_or_sub_frames_keep_their_first_marker_and_frame(tmp_path):
    path = tmp_path / "take.csv"
    path.write_text(
        "TRAJECTORIES\n240.00,Hz\n,LFHD,,,RFHD,,\nField #,X,Y,Z,X,Y,Z\n1,100,200,900,4,5,6\n2,1,2,3,4,5,6\n"
    )
    take = read_points(path)
    assert (take.names, take.rate, take.first_frame, len(take.xyz)) == (("LFHD", "RFHD"), 240, 1, 2)
    np.testing.assert_allclose(take.xyz[0, 0], [0.1, 0.2, 0.9])
    units = ",,mm,mm,mm,mm,mm,mm,mm/s,mm/s,mm/s\n"
    for changed in (vicon().replace(units, ""), vicon().replace("\n100\n", "\n100 Hz\n")):
        path.write_text(changed)
        take = read_points(path)
        assert (take.first_frame, len(take.xyz), take.rate) == (10, 5, 100)


@pytest.mark.parametrize("numbered", [True, False])
@pytest.mark.parametrize("titled", [True, False])
def test_qualisys_tsv_export(tmp_path, numbered, titled):
    path = tmp_path / "take.tsv"
    path.write_bytes(tsv(5, numbered, titled).encode())
    take = read_points(path)
    assert (take.names, take.rate, take.up) == (("LASI", "", "RASI"), 120, "+Z")
    assert take.first_frame == (7 if numbered else 1)
    np.testing.assert_allclose(take.picked([0, 1]).xyz[0], [[0.1, 0.2, 1.0], [0.011, 0.022, 0.033]])
    np.testing.assert_array_equal(take.present, [[frame != 2, True, False] for frame in range(5)])
    write_c3d(tmp_path / "named.c3d", take, take.trial)
    parameters = ezc3d.c3d(str(tmp_path / "named.c3d"))["parameters"]
    assert parameters["QTM"]["TIME_STAMP"]["value"] == ["2026-01-19, 10:19:43.755 20.5"]
    assert (parameters["EVENT"]["USED"]["value"], parameters["EVENT"]["LABELS"]["value"]) == (1, ["step"])
    np.testing.assert_allclose(parameters["EVENT"]["TIMES"]["value"], [[0], [8 / 120]])
    ((name, frame),) = read_lab(read_points(tmp_path / "named.c3d").trial, 120).events
    assert (name, frame) == ("step", pytest.approx(9, abs=1e-5))
    text = path.read_text().replace("\t3D", "\t3d")
    for written, events in (("step\t9 ", [("step", 9.0)]), ("step\tnine", []), ("\t9", []), (" \t9", [])):
        path.write_text(text.replace("step\t9", written))
        assert list(read_points(path).trial.events) == events


def test_events_that_a_c3d_has_no_room_for_are_left_out_and_told(tmp_path):
    path, named = tmp_path / "take.tsv", tmp_path / "named.c3d"
    name = "a\x01" + "é" * 200
    path.write_text(tsv().replace("EVENT", f"EVENT\t{name}\t12009\n" * 300 + "EVENT"), encoding="utf-8")
    take = read_points(path)
    notes = write_c3d(named, take, take.trial)
    assert notes == ["the C3D file has no room for 46 of 301 events, which were left out"]
    events = read_lab(read_points(named).trial, 120).events
    assert (len(events), events[0][0]) == (255, "a_" + "é" * 63)
    assert ezc3d.c3d(str(named))["parameters"]["EVENT"]["TIMES"]["value"][:, 0] == pytest.approx([1, 40 + 8 / 120])
    with named.open("rb") as file:
        assert py_c3d.Reader(file).get("EVENT:USED").uint16_value == 255
    many = [f"{'m' * 250}{at:03d}" for at in range(400)]
    crowd = replace(walk(first=1), names=tuple(many), xyz=np.ones((9, 400, 3)), residual=np.full((9, 400), np.nan))
    assert write_c3d(named, crowd, take.trial) == [
        "the C3D file has no room for 301 of 301 events, which were left out"
    ]
    assert not read_lab(read_points(named).trial, 120).events


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("take.tsv", tsv().replace("\t120", "\tEXT")),  # of a time base outside QTM
        ("take.csv", motive().replace("120.000000", "").replace("240.000000", "")),
        ("take.trc", TRC.format(rate="0", rows="1\t0.00\t1\t2\t3\n2\t0.02\t4\t5\t6\n3\t0.04\t7\t8\t9\n")),
    ],
)
def test_a_rate_that_a_text_does_not_say_may_be_given_and_times_are_not_held_against_it(tmp_path, name, text):
    (tmp_path / name).write_text(text)
    take = read_points(tmp_path / name, rate=85.0, up="z")
    assert (take.rate, take.notes) == (85.0, ())


def test_the_last_frame_of_a_trc_may_be_without_points_where_its_line_has_an_end(tmp_path):
    path, text = tmp_path / "take.trc", TRC.format(rate="100", rows="1\t0.00\t1\t2\t3\n2\t0.01\t4\t5\t6\n3\t0.02\n")
    path.write_text(text)
    assert read_trc(path).frames == 3
    path.write_text(text[:-1])
    refused("ends in the middle of a row", read_points, path)


@pytest.mark.parametrize(
    ("rows", "notes"),
    [
        ("1\t0.00\t1\t2\t3\n2\t0.01\t4\t5\t6\n3\t0.02\t7\t8\t9\n", ()),
        ("1    0.00\t  1.0\t  2\t  3\n2    0.01\t  4\t 5 \t 6\n3 0.02\t7\t8\t9 \n", ()),
        (
            "1\t0.00\t1\t2\t3\n2\t0.02\t4\t5\t6\n3\t0.04\t7\t8\t9\n",
            ("its times are of 50 frames a second, but its head says 100, which was taken",),
        ),
        ("1\t\t1\t2\t3\n2\t\t4\t5\t6\n3\t\t7\t8\t9\n", ()),
        ("1\t0\t1\t2\t3\n2\t.01\t4\t5\t6\n3\tinf\t7\t8\t9\n", ()),
        ("1\t0.0\t1\t2\t3\n2\t0.0\t4\t5\t6\n3\t0.1\t7\t8\t9\n", ()),
    ],
)
def test_spaces_and_times_in_rows_of_a_trc(tmp_path, rows, notes):
    """Programs put spaces between frame and time, and times of another rate than the head says."""
    path = tmp_path / "take.trc"
    path.write_text(TRC.format(rate="100", rows=rows))
    take = read_trc(path)
    assert (take.frames, take.notes) == (3, notes)
    xyz, _ = dense(take.frames, 1, take.parts())
    np.testing.assert_array_equal(xyz[:, 0], np.arange(1, 10).reshape(3, 3))


@pytest.mark.parametrize("ending", ["\r\n", "\r", "\n"])
def test_a_tsv_export_of_old_windows_with_a_time_code_and_left_out_frames(tmp_path, ending):
    text = tsv().replace("Time\t", "Time\tSMPTE\t").replace("\n11\t", "\n15\t")
    for frame in range(5):
        text = text.replace(f"\t{frame / 120:.5f}", f"\t{frame / 120:.5f}\t10:19:43:{frame:02d}")
    (tmp_path / "take.tsv").write_bytes(text.replace("\r\n", ending).encode().replace(b"LASI", b"\x8cil\xe9\x85\x81"))
    take = read_points(tmp_path / "take.tsv")
    assert take.names == ("Œilé…\x81", "", "RASI")
    np.testing.assert_allclose(take.picked([0]).xyz[8], [[0.104, 0.204, 1.004]])


def trc() -> str:
    return TRC.format(rate="100", rows="1\t0.01\t1\t2\t3\n3\t0.03\t1\t2\t3\n")


@pytest.mark.parametrize(
    ("export", "old", "new", "words", "line"),
    [
        (tsv, "DATA_INCLUDED\t3D", "DATA_INCLUDED\t6D", "holds 6D data; expected .* of 3D data", 8),
        (tsv, "DATA_INCLUDED", "DATA", "no DATA_INCLUDED", 1),
        (tsv, "\t120", "\tEXT", "'EXT' for its FREQUENCY; expected frames a second, written there or given", 4),
        (tsv, "MARKER_NAMES", "NAMES", "no MARKER_NAMES; expected those of its 3 markers", 1),
        (tsv, "RASI\r", "RASI\tMORE\r", "4 MARKER_NAMES; expected those of its 3 markers", 10),
        (tsv, "MARKERS\t3", "MARKERS\t4", "has 9 columns of coordinates; expected three for each of its 4 markers", 12),
        (tsv, "MARKERS\t3", f"MARKERS\t{10**80}", "expected three for each of its 1000", 12),
        (tsv, "3\r\nFREQUENCY", "2\r\nFREQUENCY", "3 MARKER_NAMES", 10),
        (tsv, "LASI X", "GONE X\tGONE Y\tGONE Z\tLASI X", "has 12 columns of coordinates", 12),
        (tsv, "\n8\t.*\r", "", "has 4 of 5 frames", 0),
        (tsv, "FRAMES\t5", "FRAMES\t6", "has 5 of 6 frames; expected all of them", 0),
        (tsv, "\n8\t0.00833\t101", "\n8\t0.00833\thello", "'hello' as a coordinate", 14),
        (tsv, "\n8\t0.00833\t101", "\n8\t0.00833\t101,5", "expected a number, with a point before decimals", 14),
        (tsv, "\n8\t", "\n7\t", "from frame 7 to 7", 14),
        (tsv, "\n8\t0.00833\t101", "\n8\t0.00833", "has 10 fields; expected 11", 14),
        (tsv, "0\r\n\\Z", "", "ends without a line end", 17),
        (vicon, "(?s)\n\n.*", "", "no section Trajectories", 1),
        (vicon, "X,Y,Z", "RX,RY,RZ", "no columns X, Y, Z", 13),
        (vicon, "(?s)Frame,Sub Frame,X.*", "", "no columns X, Y, Z", 13),
        (vicon, "\n100\n", "\nnone\n", "'none' for its rate", 10),
        (vicon, "(?s)\n14,.*", "\n14,0,1", "3 fields; expected 11", 18),
        (vicon, "(?s)\n10,0,1.*", "", "no frames", 0),
        (vicon, r",,Ann:LASI,,,\*7,,,Ann:LASI,,", "", "no columns X, Y, Z", 13),
        (vicon, "(?s).\n\nModel.*", "", "without a line end", 18),
        (motive, "Format Version,1.23,Take Name,test,", "", "settings, nor .* Vicon .csv", 1),
        (motive, "240.000000,(.*),120.000000", r"0,\1,none", "'none' for its Export Frame Rate; expected frames", 1),
        (motive, "240.000000,(.*),120.000000", r",\1,", "has no Export Frame Rate; expected frames a second", 1),
        (motive, "Frame,Time", "No,Time", "begins with Frame", 12),
        (motive, "Position", "Rotation", "no columns of marker positions", 7),
        (motive, "\\Z", "5,0.1,0,0", "4 fields; expected 15", 13),
        (motive, ",1000,", ",hello,", "'hello' as a coordinate", 8),
        (motive, "\n(4.*\n)\\Z", r"\n\1\1", "from frame 4 to 4", 13),
        (trc, "\n100\t", "\n0\t", "'0' for its DataRate; expected frames a second, written there or given", 3),
        (trc, "(?s)\tNumFrames.*", "\n", "ends in its head", 2),
        (trc, "\n3\t", "\n9999\t1\t1\t1\t1\n19998\t", "has 3 rows for frames 1–19998; expected every frame", 0),
        (trc, "\n3\t", "\n20000\t", "from frame 1 to 20000; expected frames that ascend, by 10,000 at most", 7),
        (trc, "\n1\t", "\n\t", "begins with ''; expected a frame number", 6),
        *((trc, "\n1\t.*", f"\n{row}", r"expected a (frame )?number", 6) for row in (
            "1\t0.01\t1 234.5\t2\t3", "1\t0.01\t1 2 3", "1 0.01 1 2 3", "1 234\t12.34\t1\t2\t3",
        )),
    ],
)  # fmt: skip
def test_what_is_wrong_with_a_text_is_told_with_its_line(tmp_path, export, old, new, words, line):
    path = tmp_path / {tsv: "take.tsv", trc: "take.trc"}.get(export, "take.csv")
    text, changed = re.subn(old, new, export())
    assert changed
    path.write_bytes(text.encode())
    refused(words, read_points, path, line=line)


def test_takes_without_a_point_or_of_another_kind(tmp_path):
    refused("no such file", read_points, tmp_path / "a.bvh")
    (tmp_path / "a.bvh").write_text("x")
    refused("kind that is not known", read_points, tmp_path / "a.bvh")
    empty = walk()
    write_c3d(tmp_path / "a.c3d", Points(empty.names, empty.xyz * np.nan, empty.residual, 100, 1))
    refused("no point that is present", read_points, tmp_path / "a.c3d")


def test_units_are_told_from_how_far_people_reach():
    person = walk(frames=3, points=20).xyz
    for unit, scale in (("m", 1), ("cm", 100), ("mm", 1000)):
        assert guess_unit(person * scale) == unit


@pytest.mark.parametrize("up", ["+X", "-X", "+Y", "-Y", "+Z", "-Z"])
def test_every_up_axis_becomes_z(up):
    rotation = up_rotation(up)
    axis = np.eye(3)["XYZ".index(up[1])] * (1 if up[0] == "+" else -1)
    np.testing.assert_allclose(rotation @ axis, [0, 0, 1], atol=1e-15)
    assert np.linalg.det(rotation) == pytest.approx(1)


@pytest.mark.parametrize(("write", "most"), [(write_c3d, 2e6), (write_trc, 5e6)])
def test_a_long_take_on_disk_is_written_piece_by_piece(tmp_path, write, most):
    shape = 30_000, 8
    xyz = np.memmap(tmp_path / "xyz", np.float32, "w+", shape=(*shape, 3))
    residual = np.memmap(tmp_path / "residual", np.float32, "w+", shape=shape)
    xyz[:], residual[:] = 1, 1
    with memory_within(most):
        write(tmp_path / "take", Points(tuple("ABCDEFGH"), xyz, residual, 100.0, 1))


def test_a_trc_says_the_name_that_it_will_have(tmp_path):
    with whole_file(tmp_path / "take.trc") as temporary:
        write_trc(temporary, walk())
    assert (tmp_path / "take.trc").read_text().split("\n")[0].split("\t")[3] == "take.trc"


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16"])
def test_points_are_told_from_blobs(tmp_path, encoding):
    (tmp_path / "motive.csv").write_text(motive(), encoding=encoding)
    (tmp_path / "vicon.csv").write_text(vicon(), encoding=encoding)
    (tmp_path / "blobs.csv").write_text(BLOBS)
    names = "motive.csv", "vicon.csv", "blobs.csv", "a.c3d", "a.TRC"
    assert [holds_points(tmp_path / name) for name in names] == [1, 1, 0, 1, 1]


RATE = 100.0
NAMES = ("LFHD", "C7", "SACR", "LASI", "LKNE", "RKNE", "LANK", "RANK", "LTOE", "RTOE")
HEIGHTS = (1.65, 1.45, 1.0, 1.0, 0.5, 0.5, 0.1, 0.1, 0.03, 0.03)


def person(walks: bool = True, lies: bool = False, upside_down: bool = False, frames: int = 300) -> np.ndarray:
    """(T, 10, 3) m of somebody who walks along x with feet that stand still by turns, or keeps still."""
    time = np.arange(frames) / RATE
    xyz = np.zeros((frames, len(NAMES), 3))
    xyz[..., 2] = HEIGHTS
    xyz[..., 1] = np.linspace(-0.15, 0.15, len(NAMES)) + 1.0
    if walks:
        xyz[..., 0] = (1.2 * time)[:, None]
        for side in (0, 1):
            phase = time + 0.5 * side
            step = np.floor(phase) + np.clip(2 * (phase % 1) - 1, 0, 1)  # stands for half a second, then swings
            xyz[:, [6 + side, 8 + side], 0] = (1.2 * (step - 0.5 * side))[:, None]
            xyz[:, [6 + side, 8 + side], 2] += (0.1 * np.sin(np.pi * np.clip(2 * (phase % 1) - 1, 0, 1)))[:, None]
    if upside_down:
        xyz[..., 2] = 1.75 - xyz[..., 2]
    if lies:
        xyz = np.stack([1.8 - xyz[..., 2], xyz[..., 1], 0.1 + 0.1 * xyz[..., 0]], axis=2)
    return xyz


def turned(xyz: np.ndarray, up: str) -> np.ndarray:
    """The same in a world in which `up` is up."""
    return xyz @ up_rotation(up)


POSES = {}, {"walks": False}, {"lies": True}, {"upside_down": True}


@pytest.mark.parametrize("word", [axis for axis in SIGNED_AXES if axis not in UNSURE_WORDS])
def test_the_word_of_a_file_is_believed_whatever_people_do_and_noted_where_points_contradict_it(word):
    for pose in POSES:
        for names in (NAMES, ("",) * len(NAMES)):
            assert find_up(word, turned(person(**pose), word), names).axis == word
    found = find_up(word, turned(person(), "+Y" if word[1] != "Y" else "+Z"), NAMES)
    assert found.axis == word
    assert f"says that {word} is up, but its points stand along " in found.notes[0]


@pytest.mark.parametrize("word", ["+Y", "-Z", "", "nonsense"])
@pytest.mark.parametrize("up", ["+Z", "+Y"])
@pytest.mark.parametrize("walks", [True, False])
def test_a_word_that_says_little_gives_way_to_how_the_points_stand(word, up, walks):
    for usual in ("+Z", "+Y"):
        found = find_up(word, turned(person(walks), up), ("",) * len(NAMES), usual=usual)
        assert found.axis == up
        assert len(found.notes) == (up != (word if word in SIGNED_AXES else usual))


def test_arms_spread_out_and_who_lies_are_no_height_and_nothing_to_look_at_leaves_the_likely():
    """A T-pose at the origin: as wide as tall, and its width lies on both sides of nought."""
    pose = person(walks=False)
    pose[:, :2, 1], pose[:, 2:4, 1], pose[:, 4:, 1] = 0.8, -0.8, 0.0
    for up in ("+Z", "+Y"):
        for usual in ("+Z", "+Y"):
            assert find_up("", turned(pose, up), NAMES, usual=usual).axis == up
        assert find_up("", turned(person(walks=False, lies=True), up), NAMES, usual=up).axis == up
    nowhere = np.full((50, len(NAMES), 3), np.nan)
    assert (find_up("-Z", nowhere, NAMES).axis, find_up("", nowhere, NAMES, usual="+Y").axis) == ("+Z", "+Y")


def test_where_neither_the_file_nor_its_points_tell_what_was_taken_is_noted():
    """Somebody in a wheelchair before the origin, as long as tall, with no marker near the floor, and y up."""
    sits = np.random.default_rng(0).uniform((-1.0, 0.47, -0.6), (0.2, 1.3, 0.2), (50, 40, 3))
    found = find_up("", sits, ("",) * 40)
    assert found.axis == "+Z"
    assert "does not say which axis is up, nor do its points tell: +Z was taken" in found.notes[0]
    assert find_up("+Z", sits, ("",) * 40).notes == ()


@pytest.mark.parametrize("up", ["+Z", "+Y"])
def test_who_sits_above_the_origin_does_not_stand_on_an_arm(up):
    """An athlete's trunk and arms, who reaches as far to either side as up, is 0.3 m beside the origin at most."""
    sits = np.random.default_rng(0).uniform((-0.28, -0.28, 0.65), (0.4, 0.4, 1.35), (50, 60, 3))
    assert find_up("", turned(sits, up), ("",) * 60, usual=up).axis == up


@pytest.mark.parametrize("up", ["+Z", "+Y"])
def test_of_who_leaves_the_head_that_is_seen_last_is_no_floor(up):
    leaves, usual = person(), "+Y" if up == "+Z" else "+Z"
    leaves[len(leaves) // 3 :, 1:] = np.nan
    assert find_up("", turned(leaves, up), NAMES, usual=usual).axis == up


@pytest.mark.parametrize("up", ["+Z", "+Y"])
def test_a_ghost_below_the_floor_in_a_third_of_the_frames_hides_nobody(up):
    many = np.concatenate([person() + np.array([0.0, 0.01 * place, 0.0]) for place in range(6)], axis=1)
    ghost = np.full((len(many), 1, 3), np.nan)
    ghost[::3] = many[::3, :1] - [0.0, 0.0, 2.2]
    assert find_up("", turned(np.append(many, ghost, axis=1), up), ("",) * (many.shape[1] + 1)).axis == up


def test_minus_z_is_written_where_z_is_up_and_two_people_are_no_wider_than_one():
    anybody = np.random.default_rng(0).uniform(-0.2, 0.2, (50, 10, 3))
    found = find_up("-Z", anybody, NAMES)
    assert found.axis == "+Z"
    assert "as programs write that" in found.notes[0]
    assert find_up("-Z", turned(person(), "-Z"), NAMES).axis == "-Z"
    two = np.concatenate([person(walks=False), person(walks=False) + np.array([0, 2.5, 0])], axis=1)
    names = [f"{who}:{name}" for who in ("Ann", "Bob") for name in ("M",) * len(NAMES)]
    assert find_up("+Y", two, names).axis == "+Z"


@pytest.mark.parametrize("up", ["x", "y", "z", "-x", "-y", "-z"])
def test_who_knows_better_is_believed(tmp_path, up):
    """Of a C3D that says -Z although z is up, and of a TRC."""
    xyz, axis = person(), ("" if up[0] == "-" else "+") + up.upper()
    layout, wanted = Layout(frames=len(xyz), points=len(NAMES), up="-Z"), xyz @ up_rotation(axis).T
    (tmp_path / "a.c3d").write_bytes(layout.content(1000 * xyz))
    take, there = read_points(tmp_path / "a.c3d", up=up), layout.take()[1] >= 0
    np.testing.assert_allclose(take.xyz[there], wanted[there], atol=1e-5)
    assert (take.up, take.notes) == (axis, ())
    write_trc(tmp_path / "a.trc", Points(NAMES, xyz, np.zeros(xyz.shape[:2]), RATE, 1))
    np.testing.assert_allclose(read_points(tmp_path / "a.trc", up=up).xyz, wanted, atol=1e-5)


def test_recorded_people_keep_the_axis_that_they_have_and_minus_z_turns_none_upside_down(shared_data):
    """All C3D and TRC of the people and rooms: those with y up are known by name, all others have z up."""
    y_up = {"freeform.c3d", "squat.c3d", "walk_free_01.trc"}
    folders = (*recorded.MCGILL, *recorded.ACTORS, recorded.PLATES, recorded.TENNIS, recorded.GAPS, *recorded.IN_ROOMS)
    for path in recorded.takes(shared_data, *folders):
        take = read_points(path)
        assert take.up == ("+Y" if path.name in y_up else "+Z"), path.name
        turned = any("points stand" in note for note in take.notes)
        assert turned == (path.name in y_up and path.suffix == ".c3d"), (path.name, take.notes)
    qualisys = shared_data / "blobs" / "qualisys_run" / "run.c3d"
    for path in (qualisys, *recorded.takes(shared_data, *recorded.MCGILL, *recorded.ACTORS, recorded.PLATES)):
        take = read_points(path)
        assert find_up("-Z", take.xyz, take.names).axis == "+Z", path.name


FRAMES, AT_ONCE, LENGTH = 1000, 20, 8
LANES = AT_ONCE + 1  # of which one is named, and there all of the time
COUNT = 1 + AT_ONCE * FRAMES // LENGTH


@pytest.fixture(scope="module")
def take() -> Points:
    """Somebody's many short trajectories in no order, and a marker, LASI, with a gap."""
    rng = np.random.default_rng(0)
    first = np.concatenate([[0], np.repeat(np.arange(0, FRAMES, LENGTH), AT_ONCE)])
    last = np.concatenate([[FRAMES - 1], first[1:] + LENGTH - 1])
    order = rng.permutation(COUNT)
    lanes = Lanes.packed(first[order], last[order])
    assert lanes.count == LANES
    xyz = 1 + 0.05 * np.arange(LANES)[:, None] + np.cumsum(rng.normal(0, 0.001, (FRAMES, LANES, 3)), axis=0)
    named = int(np.flatnonzero(order == 0)[0])
    xyz[400:405, lanes.lane[named]] = np.nan
    names = tuple("LASI" if index == named else "" for index in range(COUNT))
    residual = np.where(np.isfinite(xyz[..., 0]), 0.0005, np.nan)
    return Points(names, xyz, residual, 100.0, 11, None, lanes)


def in_columns(take: Points) -> Points:
    """The take with a column for each trajectory, as files have it."""
    nobody, every = np.zeros(0, int), np.arange(COUNT)
    xyz, residual = (
        Columns(np.zeros((FRAMES, 0, *values.shape[2:])), nobody, COUNT, beside_of(take, values, every))
        for values in (take.xyz, take.residual)
    )
    return Points(take.names, xyz, residual, take.rate, take.first_frame)


@pytest.fixture(scope="module")
def path(take, tmp_path_factory):
    """The take as a C3D file."""
    path = tmp_path_factory.mktemp("lanes") / "raw.c3d"
    write_c3d(path, in_columns(take))
    return path


def test_a_file_of_thousands_of_trajectories_fills_no_memory(path):
    table = FRAMES * COUNT * 24
    with memory_within(table / 3):
        found = read_points(path, up="z")
    with memory_within(table / 3):
        write_c3d(path.with_name("again.c3d"), in_columns(found))
    assert path.with_name("again.c3d").read_bytes() == path.read_bytes()


def test_lanes_hold_what_the_columns_of_a_file_hold_and_texts_are_packed_too(take, path, tmp_path):
    found, columns = read_points(path, up="z"), read_c3d(path)
    assert found.xyz.shape == (FRAMES, LANES, 3)
    assert found.names == take.names
    np.testing.assert_array_equal(found.lanes.lane, take.lanes.lane)
    shown = found.picked(range(COUNT))
    np.testing.assert_array_equal(shown.xyz, columns.xyz * 0.001)
    np.testing.assert_array_equal(shown.residual, columns.residual * 0.001)
    part = read_points(path, up="z", frames=(211, 310))
    np.testing.assert_array_equal(part.picked(range(COUNT)).xyz, columns.xyz[200:300] * 0.001)
    few = take.lanes.between(0, 40)
    part = Points(take.names, take.xyz[:40], take.residual[:40], 100.0, 11, None, few)
    shown = part.picked(range(COUNT))
    write_trc(tmp_path / "raw.trc", shown)
    found = read_points(tmp_path / "raw.trc")
    assert found.xyz.shape[1] == LANES
    text = read_trc(tmp_path / "raw.trc")
    trc, _ = dense(text.frames, COUNT, text.parts())
    np.testing.assert_array_equal(found.picked(range(COUNT)).xyz, trc * 0.001)
