# SPDX-License-Identifier: GPL-3.0-or-later
"""All else of a C3D file stays where names are put into it, as two other readers judge it."""

from dataclasses import replace

import ezc3d
import numpy as np
import pytest

from addon.core.data.errors import InputError
from addon.io.c3d.lab import read_lab
from addon.io.c3d.reading import C3dFile
from addon.io.points import FilePoints, read_points, write_c3d
from tests import recorded
from tests.io.c3d_layouts import DEC, INTEL, MIPS, SCALE, Layout
from tests.io.kept import otherwise
from tests.io.whole_columns import read_c3d

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


def layouts():
    for shape, layout in LAYOUTS.items():
        for name, processor in (("intel", INTEL), ("dec", DEC), ("mips", MIPS)):
            for real in (True, False):
                kind = "reals" if real else "integers"
                yield pytest.param(replace(layout, processor=processor, real=real), id=f"{name}-{kind}-{shape}")
    long = replace(LAB, frames=65_600, points=2, channels=1, samples=2, first=1)
    yield pytest.param(long, id="more than 65535 frames")


def named(take: FilePoints) -> FilePoints:
    """The same in another order, with other names."""
    order = np.roll(np.arange(len(take.names)), 1)
    own = {"xyz": take.xyz[:, order], "residual": take.residual[:, order]}
    return replace(take, names=tuple(f"M{index}" for index in order), **own)


def put(folder, layout: Layout, name="trial.c3d"):
    path = folder / name
    path.write_bytes(layout.content())
    return path


@pytest.mark.parametrize("layout", list(layouts()))
def test_all_else_stays(tmp_path, layout):
    source, out = put(tmp_path, layout), tmp_path / "named.c3d"
    take = named(read_points(source))
    write_c3d(out, take, take.trial)
    assert otherwise(source, out) == []
    before, after, count = read_c3d(source), read_c3d(out), len(take.names)
    assert after.labels == [*take.names, before.labels[-1]]
    assert after.scale[0] == (1 if layout.real else pytest.approx(SCALE)), "whole numbers stay such"
    order = np.roll(np.arange(count), 1)
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
    source, out = put(tmp_path, replace(LAB, processor=processor, real=real, turns=2)), tmp_path / "named.c3d"
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
    source, out = put(tmp_path, replace(LAB, real=False, lab=lab)), tmp_path / "named.c3d"
    take = read_points(source)
    take.xyz[3, 1] += 1e-5
    write_c3d(out, take, take.trial)
    assert otherwise(source, out) == []
    np.testing.assert_allclose(read_points(out).xyz, take.xyz, atol=1e-7)


def test_a_file_that_states_no_residual_gets_one_of_a_tenth_of_a_millimetre(tmp_path):
    source, out = put(tmp_path, LAB), tmp_path / "named.c3d"
    take = read_points(source)
    take.residual[:] = np.where(take.present, np.nan, np.nan)
    take.residual[2, 1] = 0
    write_c3d(out, take, take.trial)
    found = read_points(out).residual
    assert found[2, 1] == 0
    np.testing.assert_allclose(np.delete(found[take.present], np.flatnonzero(found[take.present] == 0)), 1e-4)


def test_subjects_are_said_anew_where_the_file_names_others(tmp_path):
    source, out = put(tmp_path, LAB), tmp_path / "named.c3d"
    take = read_points(source)
    write_c3d(out, take, take.trial, ["Anna"])
    assert otherwise(source, out) == []
    write_c3d(out, take, take.trial, ["1", "Jörg"])
    assert otherwise(source, out, anew=("SUBJECTS",)) == []
    said = ezc3d.c3d(str(out))["parameters"]["SUBJECTS"]
    assert [said[name]["value"] for name in ("NAMES", "LABEL_PREFIXES")] == [["1", "Jörg"], ["1:", "Jörg:"]]
    assert (said["USED"]["value"], said["USES_PREFIXES"]["value"]) == ([2], [1])


def test_a_file_that_changed_or_went_meanwhile_or_has_no_room_is_one_sentence(tmp_path):
    source = put(tmp_path, LAB)
    take = read_points(source)
    source.write_bytes(source.read_bytes() + bytes(512))
    with pytest.raises(InputError, match="changed after it was read; expected it as it was"):
        write_c3d(tmp_path / "named.c3d", take, take.trial)
    source.unlink()
    with pytest.raises(InputError, match="there is no such file"):
        write_c3d(tmp_path / "named.c3d", take, take.trial)
    source = put(tmp_path, replace(LAB, frames=4, points=600))
    take = read_points(source)
    long = replace(take, names=tuple(f"{name}{'x' * 240}" for name in take.names))
    with pytest.raises(InputError, match="has more names than a C3D file has room for, with all else that it says"):
        write_c3d(tmp_path / "named.c3d", long, take.trial)


@pytest.mark.parametrize("processor", [INTEL, DEC, MIPS])
@pytest.mark.parametrize("real", [True, False])
def test_events_and_plates_are_as_another_reader_has_them(tmp_path, processor, real):
    layout = replace(LAB, channels=12, real=real, up="+Y")
    take = read_points(put(tmp_path, replace(layout, processor=processor)))
    lab = read_lab(take.trial, take.rate)
    assert (lab.events, lab.first) == ((("Left Foot Strike", 51), ("Right Foot Off", 126)), 11)
    read = ezc3d.c3d(str(put(tmp_path, layout, "intel.c3d")), extract_forceplat_data=True)
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
    path.write_bytes((tmp_path / "trial.c3d").read_bytes().replace(b"EVENT", b"OTHER"))
    assert [name for name, _ in read_lab(read_points(path).trial, 100.0).events] == ["RHS", "RTO"]
    np.testing.assert_allclose([frame for _, frame in read_lab(read_points(path).trial, 100.0).events], [12.5, 15])


@pytest.mark.parametrize("seed", range(4))
def test_damaged_files_become_a_file_or_a_sentence(tmp_path, seed):
    rng, processor = np.random.default_rng(seed), (INTEL, DEC, MIPS, MIPS)[seed]
    layout = replace(LAB, processor=processor, real=seed < 3, turns=seed % 2)
    whole, written = layout.content(), 0
    for _ in range(150):
        content = bytearray(whole)
        for at in rng.integers(0, 2500, rng.integers(1, 6)):
            content[at] = rng.choice([0, 1, 127, 128, 255, rng.integers(256)])
        (tmp_path / "trial.c3d").write_bytes(content[: len(content) - rng.choice([0, 0, 0, 700])])
        try:
            take = read_points(tmp_path / "trial.c3d")
            read_lab(take.trial, take.rate)
            write_c3d(tmp_path / "named.c3d", take, take.trial if take.lanes is None else None, ["1"])
            written += 1
        except InputError:
            continue
    assert written > 20


def test_recorded_files_stay_as_they_are(shared_data, tmp_path):
    folders = (recorded.TENNIS, recorded.GAPS, "people/cmu41/ball", "rooms/vicon12", "blobs/qualisys_run")
    some = recorded.takes(shared_data, *folders, kinds=(".c3d",))
    for path in (*some, shared_data / "people" / "mcgill" / "HC030A" / "HC030A05.c3d"):
        take = read_points(path)
        if take.lanes is None:
            write_c3d(tmp_path / "named.c3d", take, take.trial)
            assert otherwise(path, tmp_path / "named.c3d") == [], path.name
