# SPDX-License-Identifier: GPL-3.0-or-later
"""Calibrations: every format says the same of the same cameras, and what is wrong is one sentence."""

import re
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from scipy.spatial.distance import pdist
from scipy.spatial.transform import Rotation

from addon.core.geometry.camera_up import guess_up, turned
from addon.io.cameras import read_cameras, write_cameras
from tests.io.checks import refused
from tests.io.samples import mcal, opencv_matrix, qca, ring, row, write_selfcal, xcp, yml

ROOM = np.random.default_rng(3).uniform([-1, -1, 0], [1, 1, 1.9], (50, 3))


def assert_same(found, wanted):
    assert found.names == wanted.names
    np.testing.assert_allclose(found.size, wanted.size)
    np.testing.assert_allclose(found.centres, wanted.centres, atol=1e-9)
    np.testing.assert_allclose(found.project(ROOM), wanted.project(ROOM), atol=1e-6)


def write(path, content):
    path.parent.mkdir(exist_ok=True)
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    return path


NAMES = st.characters(exclude_categories=["Cs"], exclude_characters="\0\r\n")


@given(
    st.integers(1, 5),
    st.lists(st.floats(-0.3, 0.3), min_size=5, max_size=5),
    st.lists(st.text(NAMES, min_size=1).filter(str.strip), min_size=5, max_size=5, unique=True),
)
@example(4, [-0.1, 0.05, 0.001, -0.002, 0.01], ['"quoted"\\', "Süd 1", "x\x7f\t", "b", "c"])
def test_any_rig_comes_back_exactly_from_our_own_toml(tmp_path_factory, count, lens, names):
    path = tmp_path_factory.mktemp("rig") / "cameras.toml"
    cameras = ring(count, lens, names[:count])
    write_cameras(path, cameras)
    found = read_cameras(path)
    assert found.names == cameras.names
    for field in ("size", "matrix", "distortion", "translation"):
        np.testing.assert_array_equal(getattr(found, field), getattr(cameras, field))
    np.testing.assert_allclose(found.rotation, cameras.rotation, atol=1e-15)


def test_every_format_says_the_same_and_a_self_calibration_folder_by_any_of_its_files(tmp_path):
    cameras = ring()
    assert_same(read_cameras(write(tmp_path / "a.qca.txt", qca(cameras))), cameras)
    assert_same(read_cameras(write(tmp_path / "a.xml", qca(cameras))), cameras)
    assert_same(read_cameras(write(tmp_path / "a.mcal", mcal(cameras))), cameras)
    assert_same(read_cameras(write(tmp_path / "a.yml", yml(cameras))), cameras)
    write(tmp_path / "pair" / "intri.yml", yml(cameras, extrinsics=False))
    write(tmp_path / "pair" / "extri.yml", yml(cameras, intrinsics=False))
    assert_same(read_cameras(tmp_path / "pair" / "intri.yml"), cameras)
    assert_same(read_cameras(tmp_path / "pair" / "extri.yml"), cameras)
    cameras = ring(distortion=(-0.2, 0.05, 0.001, -0.002, 0))
    write_selfcal(tmp_path / "selfcal", cameras)
    for path in ("selfcal", "selfcal/camera2.Pmat.cal", "selfcal/basename1.rad"):
        assert_same(read_cameras(tmp_path / path), cameras)
    (tmp_path / "selfcal" / "camera_order.txt").unlink()
    assert read_cameras(tmp_path / "selfcal").names == ("camera1", "camera2", "camera3", "camera4")
    (tmp_path / "selfcal" / "basename3.rad").unlink()
    refused(r"no \.rad file with the number 3", read_cameras, tmp_path / "selfcal")


BONITA = np.array([8e-7, 1.2e-12])  # a strong lens of a Bonita 10, 1024 × 1024 px: 1.75 times as wide in the corners


def bonitas():
    """Four cameras as Bonitas have them, of square pixels and without a lens."""
    rig = ring(distortion=np.zeros(5))
    matrix = np.tile([[900.0, 0, 512], [0, 900, 512], [0, 0, 1]], (4, 1, 1))
    return replace(rig, size=np.full((4, 2), 1024.0), matrix=matrix)


@pytest.mark.parametrize("radial", [(3e-8, -1e-14), BONITA])
def test_vicon_lens_and_last_key_frame(tmp_path, radial):
    """A strong one, converted to OpenCV's, was off by 4.4 px and refused."""
    cameras = bonitas()
    found = read_cameras(write(tmp_path / "a.xcp", xcp(cameras, radial)))
    assert found.names == cameras.names
    np.testing.assert_allclose(found.centres, cameras.centres, atol=1e-9)
    # Vicon's own rule: what the lens bends comes straight about the principal point.
    bent, straight = found.project(ROOM), cameras.project(ROOM)
    offset = bent - cameras.matrix[:, None, :2, 2]
    squared = (offset**2).sum(axis=2, keepdims=True)
    unbent = offset * (1 + radial[0] * squared + radial[1] * squared**2) + cameras.matrix[:, None, :2, 2]
    assert np.abs(bent - straight).max() > 0.5
    np.testing.assert_allclose(unbent, straight, atol=1e-9)


def test_a_calibration_for_theia_is_not_taken_for_one_of_qualisys(tmp_path):
    text = re.sub(r'sensorMax(.)="([\d.]+)"', lambda at: f'sensorMax{at[1]}="{float(at[2]) / 64}"', qca(ring()))
    refused("has a sensor of 11 × 8 px; expected a Qualisys", read_cameras, write(tmp_path / "a.qca.txt", text))


def test_vicon_lens_in_nexus_2s_words(tmp_path):
    text = xcp(bonitas(), BONITA)
    lens = row(BONITA)
    newer = text.replace(f'VICON_RADIAL="{lens}"', f'VICON_RADIAL2="Vicon3Parameter 512 512 {lens} 0"')
    assert newer != text
    found = [read_cameras(write(tmp_path / "a.xcp", one)).inverse for one in (text, newer)]
    np.testing.assert_array_equal(*found)


def test_vicon_names_are_those_that_tell_cameras_apart(tmp_path):
    text = xcp(ring(3, names=["A", "B", "Left"])).replace('NAME="A"', 'NAME=""').replace('NAME="B"', 'NAME=""')
    assert read_cameras(write(tmp_path / "a.xcp", text)).names == ("0", "1", "Left")
    text = text.replace('USERID="1"', 'USERID="0"')
    assert read_cameras(write(tmp_path / "a.xcp", text)).names == ("2100", "2101", "Left")


def test_a_vicon_lens_survives_our_toml_and_stands_beside_the_nearest_of_opencv(tmp_path):
    cameras = read_cameras(write(tmp_path / "a.xcp", xcp(ring(distortion=np.zeros(5)), (3e-8, -1e-14))))
    write_cameras(tmp_path / "a.toml", cameras)
    found = read_cameras(tmp_path / "a.toml")
    np.testing.assert_array_equal(found.inverse, cameras.inverse)
    np.testing.assert_array_equal(found.distortion, 0)
    # What other programs make of it: the line with the exact lens is none of theirs.
    text = re.sub("vicon_radial.*\n", "", (tmp_path / "a.toml").read_text())
    theirs = read_cameras(write(tmp_path / "theirs.toml", text))
    assert theirs.distortion.any()
    np.testing.assert_allclose(theirs.project(ROOM), cameras.project(ROOM), atol=1e-3)


def test_a_lens_of_vicon_that_folds_the_image_is_refused(tmp_path):
    refused("folds the image", read_cameras, write(tmp_path / "a.xcp", xcp(bonitas(), (-8e-6, 0))))


UPS = {
    "y": [[1, 0, 0], [0, 0, 1], [0, -1, 0]], "-y": [[1, 0, 0], [0, 0, -1], [0, 1, 0]],
    "x": [[0, 0, 1], [1, 0, 0], [0, 1, 0]], "-x": [[0, 0, -1], [1, 0, 0], [0, -1, 0]],
    "-z": [[1, 0, 0], [0, -1, 0], [0, 0, -1]],
}  # fmt: skip


@pytest.mark.parametrize("up", UPS)
def test_a_calibration_with_another_axis_up_is_turned_and_said(tmp_path, up):
    wanted = bonitas()
    lying = turned(wanted, np.array(UPS[up], dtype=float))
    axis = np.array(UPS[up])[:, 2]
    remark = f"the cameras stand with {up} up in the calibration, which does not say: turned to z up"
    assert axis @ np.eye(3)["xyz".index(up[-1])] == (-1 if up[0] == "-" else 1)
    for path in (
        write(tmp_path / "a.xcp", xcp(lying, BONITA)),
        write(tmp_path / "a.qca.txt", qca(lying)),
        write(tmp_path / "a.yml", yml(lying)),
    ):
        found = read_cameras(path)
        assert (found.remarks, guess_up(found)) == ((remark,), "z")
        np.testing.assert_allclose(found.centres[:, 2], wanted.centres[:, 2], atol=1e-9)
        np.testing.assert_allclose(pdist(found.centres), pdist(wanted.centres))
        assert np.linalg.det(found.rotation) == pytest.approx(1)
        same, as_it_is = read_cameras(path, up=up), read_cameras(path, up="z")
        np.testing.assert_array_equal(same.rotation, found.rotation)
        assert same.remarks == as_it_is.remarks == ()
        np.testing.assert_allclose(as_it_is.centres, lying.centres, atol=1e-9)


def test_up_overrules_what_a_calibration_says_and_our_own_toml_says_so_itself(tmp_path):
    path = write(tmp_path / "a.mcal", mcal(ring()))
    said, overruled = read_cameras(path), read_cameras(path, up="z")
    np.testing.assert_allclose(overruled.centres @ np.array(UPS["y"]), said.centres, atol=1e-9)
    blend = read_cameras(tmp_path / "a.blend", lambda _: said, "y")
    np.testing.assert_allclose(blend.centres, said.centres @ np.array(UPS["y"]), atol=1e-9)
    lying = turned(ring(), np.array(UPS["y"], dtype=float))
    write_cameras(tmp_path / "a.toml", lying)
    found = read_cameras(tmp_path / "a.toml")
    assert found.remarks == ()
    np.testing.assert_array_equal(found.translation, lying.translation)
    np.testing.assert_allclose(found.centres, lying.centres, atol=1e-9)


def test_cameras_that_do_not_tell_which_way_is_up_are_left_as_they_are():
    around = ring(8)
    quarter = np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]])
    portraits = replace(around, rotation=quarter @ around.rotation)
    hanging = replace(around, rotation=np.diag([-1.0, -1, 1]) @ around.rotation)
    ceiling = replace(around, rotation=np.tile(np.diag([1.0, -1, -1]), (8, 1, 1)))
    for rig in (portraits, portraits.select([0, 1, 2]), ceiling, ceiling.select([0, 1]), around.select([0])):
        assert guess_up(rig) == ""
    assert guess_up(hanging) == ""
    assert guess_up(around) == guess_up(around.select([0, 2])) == "z"


LINES = (
    "size = [640, 480]\nmatrix = [[600, 0, 320], [0, 600, 240], [0, 0, 1]]\ndistortions = [0.1, 0.2, 0, 0]\n"
    "rotation = [0.1, 0.2, 0.3]\ntranslation = [0, 0, 3]\n"
)


@pytest.mark.parametrize(
    ("text", "names"),
    [
        (f"[cameras.0]\ncam_id = 0\n{LINES}[cameras.1]\n{LINES}", ("0", "1")),
        (f"[[cameras]]\n{LINES}[[cameras]]\nname = 'b'\n{LINES}", ("0", "b")),
        (f"[cam_1]\nname = 'one'\n{LINES}[metadata]\nerror = 0.0\n", ("one",)),
        (f"[charuco]\nrows = 5\n[cam_7]\nfisheye = false\n{LINES}", ("cam_7",)),
        (f"[a]\nignore = true\nmatrix = []\n[b]\n{LINES}", ("b",)),
    ],
    ids=["nested", "listed", "beside others", "no name", "ignored"],
)
def test_toml_in_the_ways_of_other_programs(tmp_path, text, names):
    cameras = read_cameras(write(tmp_path / "a.toml", text))
    assert cameras.names == names
    np.testing.assert_allclose(cameras.rotation[0], Rotation.from_rotvec([0.1, 0.2, 0.3]).as_matrix(), atol=1e-12)
    np.testing.assert_allclose(cameras.distortion[0], [0.1, 0.2, 0, 0, 0])


GOOD = (
    "[cam]\nsize = [640, 480]\nmatrix = [[600, 0, 320], [0, 600, 240], [0, 0, 1]]\ndistortions = [0.1]\n"
    "rotation = [0, 0, 0]\ntranslation = [0, 0, 3]\n"
)


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("[0, 600, 240]", "[0, 0, 0]", "singular matrix"),
        ("600, 0, 320", "nan, 0, 320", "not made of numbers"),
        ("600, 0, 320", "'600', 0, 320", "not made of numbers"),
        ("[0, 0, 1]", "[0, 0, 2]", "0 0 1"),
        ("rotation = [0, 0, 0]", "rotation = [[1, 0, 0], [0, 1, 0], [0, 0, -1]]", "not a rotation"),
        ("rotation = [0, 0, 0]", "rotation = [1, 2]", "`rotation` of 2 numbers"),
        ("rotation = [0, 0, 0]\n", "", "no `rotation`"),
        ("distortions = [0.1]", "distortions = [0, 0, 0, 0, 0, 0.1]", "6 coefficients"),
        ("distortions = [0.1]", "distortions = [0.1]\nfisheye = true", "fisheye"),
        ("distortions = [0.1]", "distortions = [0.1]\nfisheye = 1", "fisheye"),
        ("size = [640, 480]", "size = [0, 480]", "no image size"),
        ("translation = [0, 0, 3]", "translation = [0, 0, 3e99]", "not a number of any camera"),
        ("translation = [0, 0, 3]", "translation = [1e308, 1e308, 0]", "not a number of any camera"),
        ("rotation = [0, 0, 0]", "rotation = [1e308, 1e308, 0]", "not a number of any camera"),
        *(("[cam]", f'[cam]\nname = "a\\u{sign}b"', "one line of letters") for sign in ("000a", "0000", "000d")),
        ("[cam]", "[cam", ":1: is not valid TOML"),
        ("[cam]", "[a]\n[[a]]\n[cam]", "not valid TOML"),
        ("translation", "x = = 2\ntranslation", ":6: is not valid TOML"),
        ("matrix", "matrices", "no table with a `matrix`"),
        ("[cam]", GOOD.replace("[cam]", "[two]\nname = 'cam'") + "[cam]", "same name"),
    ],
)
def test_a_calibration_that_cannot_be_is_refused(tmp_path, old, new, words):
    assert len(read_cameras(write(tmp_path / "good.toml", GOOD))) == 1
    refused(words, read_cameras, write(tmp_path / "a.toml", GOOD.replace(old, new)))


def test_motive_needs_the_standard_lens_model(tmp_path):
    text = mcal(ring()).decode("utf-16").replace("IntrinsicStandardCameraModel", "Gone")
    refused("IntrinsicStandardCameraModel", read_cameras, write(tmp_path / "a.mcal", text.encode("utf-16")))
    # The numbers of a calibration in UTF-8 are the same.
    assert_same(read_cameras(write(tmp_path / "a.mcal", mcal(ring()).decode("utf-16"))), ring())


def test_motive_looks_along_its_own_back(tmp_path):
    """A camera at (0, 1, 4) m of a y-up world, not turned at all, looks at the origin: along -z there, +y here."""
    text = (
        '<calibrationProfile><Calibration><Cameras><Camera Serial="M1"><Attributes ImagerPixelWidth="100" '
        'ImagerPixelHeight="100"/><IntrinsicStandardCameraModel LensCenterX="50" LensCenterY="50" '
        'HorizontalFocalLength="80" VerticalFocalLength="80"/><Extrinsic X="0" Y="1" Z="4" OrientMatrix0="1" '
        'OrientMatrix1="0" OrientMatrix2="0" OrientMatrix3="0" OrientMatrix4="1" OrientMatrix5="0" OrientMatrix6="0" '
        'OrientMatrix7="0" OrientMatrix8="1"/></Camera></Cameras></Calibration></calibrationProfile>'
    )
    cameras = read_cameras(write(tmp_path / "a.mcal", text))
    np.testing.assert_allclose(cameras.centres, [[0, -4, 1]], atol=1e-12)
    np.testing.assert_allclose(cameras.rotation[0, 2], [0, 1, 0], atol=1e-12)
    # Higher in the room is higher in the image (a smaller row); right of the camera is right in it.
    np.testing.assert_allclose(cameras.project(np.array([[0.4, 0, 1], [0, 0, 1.4]]))[0], [[58, 50], [50, 42]])


def test_opencv_layouts(tmp_path):
    cameras = ring(2)

    def matrices(index, *names):
        values = (cameras.matrix[index], cameras.distortion[index], cameras.rotation[index], cameras.translation[index])
        return "".join(opencv_matrix(name, value) for name, value in zip(names, values, strict=True))

    nodes = "%YAML:1.0\n---\nimage_width: 656\nimage_height: 491\n"
    for index, name in enumerate(cameras.names):
        inner = matrices(index, "camera_matrix", "distortion_coefficients", "rotation", "translation")
        nodes += f"{name}:\n" + "".join(f"   {line}\n" for line in inner.splitlines())
    assert_same(read_cameras(write(tmp_path / "nodes.yml", nodes)), cameras)
    alone = "%YAML:1.0\n---\nsize: [656, 491]\n" + matrices(0, "camera_matrix", "dist_coeffs", "R", "tvec")
    assert_same(read_cameras(write(tmp_path / "cam_1.yml", alone)), cameras.select([0]))
    stereo = "%YAML:1.0\n---\n" + opencv_matrix("M1", cameras.matrix[0]) + opencv_matrix("D1", cameras.distortion[0])
    stereo += opencv_matrix("M2", cameras.matrix[1]) + opencv_matrix("D2", cameras.distortion[1])
    write(tmp_path / "s" / "intrinsics.yml", stereo)
    pose = opencv_matrix("R", cameras.rotation[1]) + opencv_matrix("T", 1000 * cameras.translation[1])
    write(tmp_path / "s" / "extrinsics.yml", "%YAML:1.0\n---\n" + pose)
    found = read_cameras(tmp_path / "s" / "intrinsics.yml")
    assert found.names == ("1", "2")
    np.testing.assert_allclose(found.translation, [[0, 0, 0], cameras.translation[1]], atol=1e-12)
    np.testing.assert_allclose(found.size, np.round(2 * cameras.matrix[:, :2, 2]))
    (tmp_path / "s" / "extrinsics.yml").unlink()
    refused(r"needs extrinsics\.yml beside it", read_cameras, tmp_path / "s" / "intrinsics.yml")


def test_a_broken_matrix_of_opencv_is_told_with_its_line(tmp_path):
    text = "%YAML:1.0\n---\nK_1: !!opencv-matrix\n   rows: 3\n   cols: 3\n   dt: d\n   data: [ 1., 2. ]\n"
    refused(r"a\.yml:7: .*2 numbers for 3×3", read_cameras, write(tmp_path / "a.yml", text))


def test_kinds_that_are_no_calibration(tmp_path):
    refused("only Blender", read_cameras, tmp_path / "room.blend")
    assert read_cameras(tmp_path / "room.blend", read_blend=lambda path: path.name) == "room.blend"
    for name in ("take.c3d", "cameras"):
        refused(r"kind that is not known.*\.toml", read_cameras, write(tmp_path / name, "x"))
    refused("<html> at its root", read_cameras, write(tmp_path / "a.xml", "<html/>"))
    refused("document type", read_cameras, write(tmp_path / "a.xcp", '<!DOCTYPE a [<!ENTITY b "c">]><a>&b;</a>'))
    refused("no such file", read_cameras, tmp_path / "none.xcp")
