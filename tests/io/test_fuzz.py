# SPDX-License-Identifier: GPL-3.0-or-later
"""Whatever a file holds, a reader gives its content or one InputError: never another exception, never a hang."""

import random
import shutil
import time
import warnings
from pathlib import Path

import numpy as np
import pytest

from addon.core.errors import InputError
from addon.core.takes import Points
from addon.io.blobs import read_blobs
from addon.io.cameras import read_cameras
from addon.io.labels import LabelFile
from addon.io.markersets import builtin_markersets, read_markerset, write_markerset
from addon.io.models import read_model
from addon.io.points import read_points
from tests.core.toybody import toy_markerset
from tests.io.samples import ring, write_all

ROUNDS = 150
SECONDS = 1.5

TOKENS = [
    b"nan", b"inf", b"-1e999", b"1e308", b"0", b"-1", b"999999999999", b"", b",", b"\n", b'"', b"'", b"\0", b"\xff\xfe",
    b"[", b"]", b"{", b"}", b"<", b">", b"/>", b":", b"- ", b"  ", b"\t", b"\r", b"\xe2\x82\xac", b"true", b"null",
    b"65536", b"\x7f", b"_", b"1_0", b"1e400", b"&amp;", b"!!opencv-matrix", b"#", b"%", b"=",
]  # fmt: skip


def read_all_blobs(path: Path):
    cameras = ring()
    return sum(len(rows.blobs) for rows in read_blobs(path, cameras))


def read_labels(path: Path):
    with LabelFile(path) as file:
        return sum(1 for _ in file.rows())


def read_take(path: Path) -> Points:
    read_points(path, everything=True)
    return read_points(path)


READERS = {
    "toml": read_cameras, "xcp": read_cameras, "qca": read_cameras, "mcal": read_cameras, "yml": read_cameras,
    "pmat": read_cameras, "rad": read_cameras, "res": lambda path: read_cameras(path.parent), "blobs": read_all_blobs,
    "labels": read_labels, "c3d": read_take, "dec": read_take, "mips": read_take, "trc": read_take,
    "motive": read_take, "markerset": read_markerset, "model": read_model,
}  # fmt: skip


def mutated(content: bytes, chance: random.Random) -> bytes:
    """`content` with one to four wounds: cuts, changed bits, doubled parts, tokens that readers stumble over."""
    changed = bytearray(content)
    for _ in range(chance.randint(1, 4)):
        at = chance.randrange(len(changed) + 1)
        kind = chance.randrange(7)
        if kind == 0:
            del changed[at:]
        elif kind == 1 and changed:
            changed[at % len(changed)] = chance.randrange(256)
        elif kind == 2:
            changed[at:at] = chance.choice(TOKENS)
        elif kind == 3:
            changed[at : at + chance.randint(1, 12)] = chance.choice(TOKENS)
        elif kind == 4:
            del changed[at : at + chance.randint(1, 40)]
        elif kind == 5:
            other = chance.randrange(len(changed) + 1)
            changed[at:at] = changed[other : other + chance.randint(1, 60)]
        else:
            lines = bytes(changed).split(b"\n")
            lines.insert(
                chance.randrange(len(lines)), lines.pop(chance.randrange(len(lines))) if len(lines) > 1 else b""
            )
            changed = bytearray(b"\n".join(lines))
    return bytes(changed)


@pytest.fixture(scope="module")
def files(tmp_path_factory) -> dict[str, Path]:
    folder = tmp_path_factory.mktemp("samples")
    files = write_all(folder)
    files["markerset"] = folder / "toy.markerset.json"
    write_markerset(files["markerset"], toy_markerset())
    return files


@pytest.mark.parametrize("kind", READERS)
def test_a_damaged_file_gives_its_content_or_an_input_error(kind, files, tmp_path):
    shutil.copytree(files[kind].parent, tmp_path / "case")
    path = tmp_path / "case" / files[kind].name
    content, reader = path.read_bytes(), READERS[kind]
    reader(path)
    chance = random.Random(f"seed of {kind}")
    refused, begin = 0, time.perf_counter()
    for round_ in range(ROUNDS):
        path.write_bytes(mutated(content, chance))
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            try:
                reader(path)
            except InputError as error:
                refused += 1
                assert error.message
                assert error.file, f"the error of round {round_} does not name its file: {error}"
                assert "\n" not in error.message
        if time.perf_counter() - begin > SECONDS:
            break
    assert refused, "no damage was ever noticed"


@pytest.mark.parametrize("kind", READERS)
@pytest.mark.parametrize(
    "content",
    [
        b"",
        b"\0" * 3000,
        b"\x89PNG\r\n\x1a\n" + bytes(range(256)) * 8,
        b"hello\n",
        b"\xff\xfe",
        b"[" * 5000,
        b"<a>" * 5000,
    ],
    ids=["empty", "zeros", "picture", "text", "mark", "brackets", "tags"],
)
def test_a_file_of_the_wrong_kind_is_refused_in_one_sentence(kind, content, files, tmp_path):
    shutil.copytree(files[kind].parent, tmp_path / "case")
    path = tmp_path / "case" / files[kind].name
    path.write_bytes(content)
    with pytest.raises(InputError) as caught:
        READERS[kind](path)
    assert Path(caught.value.file).parent in (path.parent, path)


@pytest.mark.parametrize("kind", [kind for kind in READERS if kind != "res"])
def test_a_missing_file_and_a_folder_are_refused(kind, files, tmp_path):
    missing = tmp_path / files[kind].name
    with pytest.raises(InputError):
        READERS[kind](missing)
    missing.mkdir()
    with pytest.raises(InputError):
        READERS[kind](missing)


def test_every_built_in_marker_set_survives_damage(tmp_path):
    chance = random.Random(5)
    for source in builtin_markersets().values():
        content = source.read_bytes()
        for _ in range(10):
            path = tmp_path / "damaged.markerset.json"
            path.write_bytes(mutated(content, chance))
            try:
                assert len(read_markerset(path))
            except InputError as error:
                assert error.message


def test_the_samples_are_what_their_readers_say(files):
    for kind in ("toml", "xcp", "qca", "mcal", "yml", "pmat"):
        assert len(read_cameras(files[kind])) == 4
    for kind in ("c3d", "dec", "mips", "trc"):
        assert np.isfinite(read_points(files[kind]).xyz).any()
