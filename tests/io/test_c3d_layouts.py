# SPDX-License-Identifier: GPL-3.0-or-later
"""C3D files of every processor and layout, and all else in them that stays; judged by another reader."""

import re
from dataclasses import replace

import ezc3d
import numpy as np
import pytest

from addon.core.data.errors import InputError
from addon.core.data.takes import Points
from addon.io.c3d.file import C3dFile
from addon.io.c3d.lab import read_lab
from addon.io.c3d.writing import first_number, write_c3d_file
from addon.io.points import read_points, write_c3d
from tests import recorded
from tests.io.c3d_layouts import BLOCK, DEC, INTEL, MIPS, SCALE, Layout, read_c3d
from tests.io.checks import refused
from tests.io.kept import otherwise

PROCESSORS = {"intel": INTEL, "dec": DEC, "mips": MIPS}
SHAPES = {
    "no analog": Layout(),
    "one analog sample a frame": Layout(channels=4, samples=1),
    "ten analog samples a frame": Layout(channels=3, samples=10),
    "late first frame": Layout(first=60_000),
    "first frame beyond sixteen bits": Layout(first=70_000, channels=2, samples=2),
    "more than 255 labels": Layout(points=600, frames=3),
    "more than 65535 frames": Layout(frames=65_600, points=1),
    "one frame": Layout(frames=1, points=1),
    "residuals without a sign": Layout(residuals="unsigned"),
}


def layouts(shapes: dict[str, Layout]):
    """Each of the shapes for every processor, in reals and in whole numbers."""
    for shape, layout in shapes.items():
        for name, processor in PROCESSORS.items():
            for real in (True, False):
                if real or layout.residuals == "signed":
                    kind = "reals" if real else "integers"
                    yield pytest.param(replace(layout, processor=processor, real=real), id=f"{name}-{kind}-{shape}")


def written(folder, layout: Layout, name="take.c3d", **changes):
    path = folder / name
    path.write_bytes(replace(layout, **changes).content())
    return path


def is_read(take, layout: Layout):
    """The points, residuals and labels of the layout are what was read."""
    xyz, word = layout.take()
    missing = word < 0
    assert (take.labels, take.rate, take.first_frame) == (layout.labels(), layout.rate, layout.first)
    np.testing.assert_array_equal(np.isnan(take.xyz).all(axis=2), missing)
    np.testing.assert_allclose(take.xyz[~missing], xyz[~missing], atol=2e-4)
    # The low byte in steps of the scale, whatever cameras the high byte names.
    np.testing.assert_allclose(take.residual[~missing], (word[~missing] & 0xFF) * SCALE, rtol=1e-6)
    assert np.isnan(take.residual[missing]).all()


@pytest.mark.parametrize("layout", list(layouts(SHAPES)))
def test_every_layout_is_read(tmp_path, layout):
    take = read_c3d(written(tmp_path, layout))
    is_read(take, layout)
    assert take.notes == ()


def test_a_fourth_word_that_is_no_16_bit_number_is_no_residual(tmp_path):
    layout = Layout()
    content = bytearray(layout.content())
    start = len(content) - BLOCK * -(-layout.frames * layout.points * 16 // BLOCK)
    for place, value in ((12, 1.7e38), (28, -1e30), (44, float("nan"))):
        content[start + place : start + place + 4] = layout.reals([value])
    (tmp_path / "take.c3d").write_bytes(content)
    take = read_c3d(tmp_path / "take.c3d")
    assert np.isnan(take.residual[0]).all()
    assert np.isfinite(take.xyz[0]).all(axis=1).tolist() == [True, False, False]


@pytest.mark.parametrize("processor", PROCESSORS.values(), ids=PROCESSORS)
@pytest.mark.parametrize("blocks", [0, 1, 2])
def test_parameters_go_on_to_the_data_whatever_their_number_of_blocks(tmp_path, processor, blocks):
    layout = Layout(processor=processor, points=200, frames=3)
    is_read(read_c3d(written(tmp_path, layout, blocks=blocks)), layout)


def more_behind(content: bytes) -> bytes:
    """As of programs that write more frames than they count."""
    return content + b"\1" * 1024


def sixteen_bits(content: bytes) -> bytes:
    """Without the words that count more than 65535 frames, as ezc3d writes files."""
    return content.replace(b"TRIAL", b"OTHER").replace(b"LONG_FRAMES", b"LANG_FRAMES")


MANY, LIE_OF_MANY = Layout(frames=65_601, points=2, first=1), {"said_frames": 65535, "header": ((4, 65535),)}


@pytest.mark.parametrize(
    ("layout", "lie", "change", "words"),
    [
        (Layout(channels=4, samples=8), {"header": ((2, 4),)}, bytes, "4 words of analog data, but 32 fill the file"),
        (Layout(channels=4, samples=8, real=False), {"header": ((2, 4),)}, bytes, "but 32 fill"),
        (Layout(channels=4, samples=8, frames=90), {"header": ((2, 0),)}, bytes, "0 words of analog data, but 32 fill"),
        (Layout(frames=90), {"said_frames": 91}, bytes, "91 frames, but 90 fill it"),
        (Layout(frames=90), {"said_frames": 50}, bytes, "50 frames, but 90 fill it"),
        (Layout(frames=90, points=5), {"header": ((1, 9),)}, bytes, "9 points, but 5 fill the file"),
        (Layout(frames=90, points=5), {}, more_behind, r"holds 1\d{3} bytes more, which were passed over"),
        (MANY, LIE_OF_MANY, sixteen_bits, "in places that it has 65535 frames, but 65601 fill it and were read"),
    ],
)
def test_what_a_file_says_otherwise_in_places_is_judged_by_what_fills_it(tmp_path, layout, lie, change, words):
    path = written(tmp_path, layout, **lie)
    path.write_bytes(change(path.read_bytes()))
    take = read_c3d(path)
    is_read(take, layout)
    [note] = take.notes
    assert re.search(words, note)


def test_a_word_about_points_in_the_groups_alone_changes_nothing(tmp_path):
    layout = Layout(frames=90, points=5)
    take = read_c3d(written(tmp_path, layout, said_points=7))
    del take.labels[layout.points :]
    is_read(take, layout)


@pytest.mark.parametrize("processor", [INTEL, DEC, MIPS])
def test_of_two_scales_of_whole_numbers_the_group_s_is_taken_and_told(tmp_path, processor):
    """As in MACsample of c3d.org's sample 6, the one of 279 files at hand whose scales differ."""
    layout = Layout(frames=90, points=5, processor=processor, real=False)
    path = written(tmp_path, layout)
    path.write_bytes(path.read_bytes().replace(layout.reals([SCALE]), layout.reals([0.02]), 1))
    take = read_c3d(path)
    is_read(take, layout)
    assert take.notes == ("the header says a scale of 0.02, but the groups' 0.05 was taken",)
    whole = read_points(path)
    write_c3d(tmp_path / "named.c3d", whole, whole.trial)
    is_read(read_c3d(tmp_path / "named.c3d"), layout)


def test_a_file_that_ends_with_a_frame_has_the_frames_that_are_there(tmp_path):
    layout = Layout(frames=31, points=7, padded=False)
    path = written(tmp_path, layout, said_frames=1149, header=((4, 1149),))
    content = path.read_bytes()
    at = content.index(b"ACTUAL_END_FIELD") + len("ACTUAL_END_FIELD") + 5
    path.write_bytes(content[:at] + (1149).to_bytes(4, "little") + content[at + 4 :])
    take = read_c3d(path)
    is_read(take, layout)
    assert take.notes == ("the file says that it has 1149 frames, but ends with the end of frame 31: those were read",)
    path.write_bytes(path.read_bytes()[:-1])
    refused("has data for 30 of 1149 frames; expected a whole C3D file", read_c3d, path)
    path = written(tmp_path, layout, said_frames=0, header=((3, 1), (4, 0)))
    path.write_bytes(path.read_bytes().replace(b"TRIAL", b"OTHER")[:-1])
    refused("says nowhere how many frames it has; expected a whole C3D file", read_c3d, path)


def test_what_is_cut_off_within_a_frame_is_not_to_be_relied_on(tmp_path):
    path = written(tmp_path, MANY, **LIE_OF_MANY)
    path.write_bytes(sixteen_bits(path.read_bytes()).rstrip(b"\0")[:-9])
    assert len(read_c3d(path).xyz) == 65535


@pytest.mark.parametrize("real", [True, False])
@pytest.mark.parametrize("counted", [True, False])
@pytest.mark.parametrize("behind", [bytes(1024), bytes(4096), b"\1\2\3\4" * 512, b"\0\0\x80?" * 512])
def test_what_is_behind_the_most_that_sixteen_bits_count_is_no_frame(tmp_path, real, counted, behind):
    path = written(tmp_path, Layout(frames=65_535, points=2, real=real))
    content = path.read_bytes()
    path.write_bytes((content if counted else sixteen_bits(content)) + behind)
    take = read_c3d(path)
    assert len(take.xyz) == 65535
    assert [note.partition(" the file")[0] for note in take.notes] == ["behind its 65535 frames"]


@pytest.mark.parametrize("cut", [1, 333, 5000])
@pytest.mark.parametrize("lie", [{}, {"header": ((2, 3),)}])
def test_a_file_that_is_cut_off_is_refused_still(tmp_path, cut, lie):
    layout = Layout(frames=200, channels=3, samples=5, padded=False)
    for lacks, changes in ((cut, {}), (cut + 16 * 3 * 200, lie)):
        path = written(tmp_path, layout, **changes)
        path.write_bytes(path.read_bytes()[:-lacks])
        refused("has data for", read_c3d, path)


@pytest.mark.parametrize("first", [2**31 - 3, 2**31, 2**32 - 6, 2**32 - 5, 2**32, 5_000_000_000, -1])
def test_first_frames_past_every_limit_are_written_so_that_they_are_read(tmp_path, first):
    xyz = np.random.default_rng(0).uniform(-1, 1, (6, 2, 3))
    write_c3d(tmp_path / "a.c3d", Points(("A", "B"), xyz, np.zeros((6, 2)), 100.0, first))
    take = read_points(tmp_path / "a.c3d")
    assert take.first_frame == first_number(first, 6) == (first if 0 <= first <= 2**32 - 6 else 0)
    assert take.xyz.shape == xyz.shape
    assert ezc3d.c3d(str(tmp_path / "a.c3d"))["data"]["points"].shape == (4, 2, 6)


@pytest.mark.parametrize(
    ("names", "found"),
    [
        (["x" * 300], ["x" * 255]),
        (["x" * 300 + "a", "x" * 300 + "b"], ["x" * 255, "x" * 247 + "~2"]),
        (["é" * 200], ["é" * 127]),
        (["𝄞" * 64, "ok"], ["𝄞" * 63, "ok"]),
        (["a\nb", "a_b", "a\0b"], ["a_b~2", "a_b", "a_b~3"]),
        (["\ud800x"], ["_x"]),
    ],
)
def test_names_that_a_c3d_file_cannot_hold_come_back_as_near_as_can_be(tmp_path, names, found):
    count = len(names)
    write_c3d_file(tmp_path / "a.c3d", names, np.ones((2, count, 3)), np.zeros((2, count)), 100.0, 1)
    assert read_c3d(tmp_path / "a.c3d").labels == found


def test_a_letter_that_another_program_cut_in_two_costs_that_letter_only(tmp_path):
    path = tmp_path / "a.c3d"
    write_c3d_file(path, ["Fußspitzé"], np.ones((2, 1, 3)), np.zeros((2, 1)), 100.0, 1)
    content = path.read_bytes()
    path.write_bytes(content.replace("spitzé".encode(), b"spitze\xc3"))
    assert read_c3d(path).labels == ["Fußspitze"]
    path.write_bytes(content.replace("Fußspitzé".encode(), "Füße".encode("latin-1").ljust(11)))
    assert read_c3d(path).labels == ["Füße"]


def test_a_sample_with_a_negative_word_of_any_size_is_missing(tmp_path):
    layout = Layout(frames=2, points=1)
    for real in (True, False):
        content = replace(layout, real=real).content(np.full((2, 1, 3), 5.0))
        width = 4 if real else 2
        start = len(content) - BLOCK
        word = layout.reals([-20000]) if real else (-20000).to_bytes(2, "little", signed=True)
        at = start + 3 * width
        (tmp_path / "a.c3d").write_bytes(content[:at] + word + content[at + width :])
        assert np.isnan(read_c3d(tmp_path / "a.c3d").xyz[0]).all()


LAB = Layout(frames=40, points=6, first=11, channels=3, samples=4, lab=True)
LAYOUTS = {
    "no analog data": replace(LAB, channels=0, samples=0),
    "one sample a frame": replace(LAB, samples=1),
    "four samples a frame": LAB,
    "a first frame beyond sixteen bits": replace(LAB, first=70_000),
    "more than 255 points": replace(LAB, frames=4, points=300),
    "metres with y up": replace(LAB, up="+Y"),
    "rotations": replace(LAB, turns=3),
    "a header that counts analog data wrongly": replace(LAB, frames=90, header=((2, 3),)),
}


LONG = pytest.param(replace(LAB, frames=65_600, points=2, channels=1, samples=2, first=1), id="more than 65535 frames")


@pytest.mark.parametrize("layout", [*layouts(LAYOUTS), LONG])
def test_all_else_stays(tmp_path, layout):
    source, out = written(tmp_path, layout), tmp_path / "named.c3d"
    take = read_points(source)
    order = np.roll(np.arange(len(take.names)), 1)
    names = tuple(f"M{index}" for index in order)
    take = replace(take, names=names, xyz=take.xyz[:, order], residual=take.residual[:, order])
    write_c3d(out, take, take.trial)
    assert otherwise(source, out) == []
    before, after, count = read_c3d(source), read_c3d(out), len(take.names)
    assert after.labels == [*take.names, before.labels[-1]]
    assert after.scale[0] == (1 if layout.real else pytest.approx(SCALE)), "whole numbers stay such"
    np.testing.assert_array_equal(after.xyz[:, :count], before.xyz[:, order])
    residual = np.maximum(before.residual[:, order], np.where(before.residual[:, order] > 0, SCALE, 0))
    np.testing.assert_allclose(after.residual[:, :count], residual, rtol=1e-6)
    texts = C3dFile(out.read_bytes(), out).all_texts()
    assert texts["POINT:DESCRIPTIONS" if count < 255 else "POINT:DESCRIPTIONS2"][-1] == f"of {before.labels[-1]}"
    again = read_points(out, up=take.up.lower().removeprefix("+"))
    np.testing.assert_allclose(again.xyz, take.xyz, atol=1e-9)


@pytest.mark.parametrize("processor", [INTEL, DEC, MIPS])
@pytest.mark.parametrize("real", [True, False])
def test_of_a_part_the_events_stay_where_they_were(tmp_path, processor, real):
    source, out = written(tmp_path, replace(LAB, processor=processor, real=real, turns=2)), tmp_path / "named.c3d"
    take = read_points(source, frames=(14, 20))
    write_c3d(out, take, take.trial)
    assert otherwise(source, out, (14, 20)) == []
    read = ezc3d.c3d(str(out))
    # Those of the header count from the first frame of the file, those of the group from frame 1.
    np.testing.assert_allclose(read["header"]["events"]["events_time"][:3], [-0.015, 0.01, 0], atol=1e-7)
    assert read["header"]["events"]["events_label"][:2] == ("RHS ", "RTO ")
    np.testing.assert_allclose(read["parameters"]["EVENT"]["TIMES"]["value"], [[0, 0], [0.5, 1.25]])
    assert read["parameters"]["TRIAL"]["ACTUAL_START_FIELD"]["value"].tolist() == [14, 0]


@pytest.mark.parametrize("lab", [True, False])
def test_what_no_whole_number_holds_is_written_as_reals(tmp_path, lab):
    source, out = written(tmp_path, replace(LAB, real=False, lab=lab)), tmp_path / "named.c3d"
    take = read_points(source)
    take.xyz[3, 1] += 1e-5
    write_c3d(out, take, take.trial)
    assert otherwise(source, out) == []
    np.testing.assert_allclose(read_points(out).xyz, take.xyz, atol=1e-7)


def test_a_file_that_states_no_residual_gets_one_of_a_tenth_of_a_millimetre(tmp_path):
    source, out = written(tmp_path, LAB), tmp_path / "named.c3d"
    take = read_points(source)
    take.residual[:] = np.nan
    take.residual[2, 1] = 0
    write_c3d(out, take, take.trial)
    found = read_points(out).residual
    assert found[2, 1] == 0
    np.testing.assert_allclose(found[take.present & (found != 0)], 1e-4)


def test_subjects_are_said_anew_where_the_file_names_others(tmp_path):
    source, out = written(tmp_path, LAB), tmp_path / "named.c3d"
    take = read_points(source)
    write_c3d(out, take, take.trial, ["Anna"])
    assert otherwise(source, out) == []
    said = ezc3d.c3d(str(out))["parameters"]["SUBJECTS"]
    assert [said[name]["value"] for name in ("NAMES", "LABEL_PREFIXES")] == [["Anna"], ["Anna:"]]
    assert said["USES_PREFIXES"]["value"] == [1]
    write_c3d(out, take, take.trial, ["1", "Jörg"])
    assert otherwise(source, out, anew=("SUBJECTS",)) == []
    said = ezc3d.c3d(str(out))["parameters"]["SUBJECTS"]
    assert [said[name]["value"] for name in ("NAMES", "LABEL_PREFIXES")] == [["1", "Jörg"], ["1:", "Jörg:"]]
    assert (said["USED"]["value"], said["USES_PREFIXES"]["value"]) == ([2], [1])
    both, one = read_points(out), tmp_path / "one.c3d"
    write_c3d(one, both, both.trial, ["Jörg"])
    assert otherwise(out, one) == [], "of two whom the file names, both stay named where one is written"
    bare, prefixed = tmp_path / "bare.c3d", replace(both, names=("Jörg:C7", *both.names[1:]))
    write_c3d(bare, both, both.trial)
    assert otherwise(out, bare, anew=("SUBJECTS",)) == []
    said = ezc3d.c3d(str(bare))["parameters"]["SUBJECTS"]
    assert (said["NAMES"]["value"], said["USES_PREFIXES"]["value"]) == (["1", "Jörg"], [0])
    write_c3d(bare, prefixed, both.trial)
    assert otherwise(out, bare) == []


def test_a_file_that_changed_or_went_meanwhile_or_has_no_room_is_one_sentence(tmp_path):
    source = written(tmp_path, LAB)
    take = read_points(source)
    source.write_bytes(source.read_bytes() + bytes(512))
    given = write_c3d, tmp_path / "named.c3d", take, take.trial
    refused("changed after it was read; expected it as it was", *given, file=source)
    source.unlink()
    refused("there is no such file", *given, file=source)
    source = written(tmp_path, replace(LAB, frames=4, points=600))
    take = read_points(source)
    long = replace(take, names=tuple(f"{name}{'x' * 240}" for name in take.names))
    with pytest.raises(InputError, match="has more names than a C3D file has room for, with all else that it says"):
        write_c3d(tmp_path / "named.c3d", long, take.trial)


@pytest.mark.parametrize("processor", [INTEL, DEC, MIPS])
@pytest.mark.parametrize("real", [True, False])
def test_events_and_plates_are_as_another_reader_has_them(tmp_path, processor, real):
    layout = replace(LAB, channels=12, real=real, up="+Y")
    take = read_points(written(tmp_path, replace(layout, processor=processor)))
    lab = read_lab(take.trial, take.rate)
    assert (lab.events, lab.first) == ((("Left Foot Strike", 51), ("Right Foot Off", 126)), 11)
    read = ezc3d.c3d(str(written(tmp_path, layout, "intel.c3d")), extract_forceplat_data=True)
    turn, pushing = take.trial.turn.T, 0
    for ours, other in zip(lab.plates, read["data"]["platform"], strict=True):
        force, place = (other[name][:, :: layout.samples].T @ turn for name in ("force", "center_of_pressure"))
        np.testing.assert_allclose(ours.corners, other["corners"].T @ turn / 1000, atol=1e-6)
        np.testing.assert_allclose(ours.force, force, rtol=1e-6, atol=1e-3)
        known = np.isfinite(ours.place).all(axis=1)
        pushing += known.sum()
        np.testing.assert_allclose(ours.place[known], place[known] / 1000, rtol=1e-5, atol=1e-5)
    assert pushing > layout.frames
    path = tmp_path / "header.c3d"  # where there is no group, the header's are told
    path.write_bytes((tmp_path / "take.c3d").read_bytes().replace(b"EVENT", b"OTHER"))
    assert [name for name, _ in read_lab(read_points(path).trial, 100.0).events] == ["RHS", "RTO"]
    np.testing.assert_allclose([frame for _, frame in read_lab(read_points(path).trial, 100.0).events], [12.5, 15])


@pytest.mark.parametrize("seed", range(4))
def test_damaged_files_become_a_file_or_a_sentence(tmp_path, seed):
    rng, processor = np.random.default_rng(seed), (INTEL, DEC, MIPS, MIPS)[seed]
    layout = replace(LAB, processor=processor, real=seed < 3, turns=seed % 2)
    whole, count = layout.content(), 0
    for _ in range(150):
        content = bytearray(whole)
        for at in rng.integers(0, 2500, rng.integers(1, 6)):
            content[at] = rng.choice([0, 1, 127, 128, 255, rng.integers(256)])
        (tmp_path / "take.c3d").write_bytes(content[: len(content) - rng.choice([0, 0, 0, 700])])
        try:
            take = read_points(tmp_path / "take.c3d")
            read_lab(take.trial, take.rate)
            write_c3d(tmp_path / "named.c3d", take, take.trial if take.lanes is None else None, ["1"])
            count += 1
        except InputError:
            continue
    assert count > 20


def test_recorded_files_stay_as_they_are(shared_data, tmp_path):
    folders = (recorded.TENNIS, recorded.GAPS, "people/cmu41/ball", "rooms/vicon12", "blobs/qualisys_run")
    some = recorded.takes(shared_data, *folders, kinds=(".c3d",))
    for path in (*some, shared_data / "people" / "mcgill" / "HC030A" / "HC030A05.c3d"):
        take = read_points(path)
        if take.lanes is None:
            write_c3d(tmp_path / "named.c3d", take, take.trial)
            assert otherwise(path, tmp_path / "named.c3d") == [], path.name
