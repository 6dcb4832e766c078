# SPDX-License-Identifier: GPL-3.0-or-later
"""Whatever a file holds, a reader gives its content or one InputError, in at most 5 s and 1 GB."""

import json
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from addon.core.data.errors import InputError
from addon.io.cameras import read_cameras
from addon.io.markersets import document_of
from tests.core.toybody import toy_markerset
from tests.fuzz import READERS, answer, read_within, samples
from tests.io.checks import refused
from tests.io.samples import ring, yml

ROOT = Path(__file__).resolve().parents[2]
limited = pytest.mark.skipif(sys.platform == "win32", reason="this system has no limits for a process")
PICTURE = b"\x89PNG\r\n\x1a\n" + bytes(range(256)) * 8


@pytest.fixture(scope="module")
def files(tmp_path_factory) -> dict[str, Path]:
    return samples(tmp_path_factory.mktemp("samples"))


@pytest.mark.parametrize("kind", READERS)
@pytest.mark.parametrize(
    "content",
    [b"", b"\0" * 3000, PICTURE, b"hello\n", b"\xff\xfe", b"[" * 5000, b"<a>" * 5000],
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


@limited
def test_the_command_finds_no_fault_in_any_reader():
    command = [sys.executable, "-m", "tests.fuzz", "--count", "15", "--seed", "1"]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    told = re.findall(r"^(\w+): 15 files, \d+ refused, \d+ read, 0 faults", done.stdout, re.MULTILINE)
    assert told == list(READERS)


@pytest.mark.parametrize(
    ("error", "said"),
    [
        (KeyError("x"), "KeyError: 'x'"),
        (MemoryError(), "takes over"),
        (InputError("is odd", "a.csv"), "is no sentence of what is wrong"),
        (InputError("is odd; expected an even one"), "names no file"),
    ],
)
def test_a_reader_that_does_what_none_may_is_told(error, said):
    def read():
        raise error

    assert said in answer(read)[0]


MEGA = 1 << 20
TABLE = "[c{0}]\nsize=[9,9]\nmatrix=[1,0,0,0,1,0,0,0,1]\ndistortions=[0]\nrotation=[0,0,0]\ntranslation=[0,0,3]\n"
NODE = "K_{0}:\n rows: 3\n cols: 3\n data: [1,0,0,0,1,0,0,0,1]\n"
CAMERA = (
    '<Camera NAME="{0}" SENSOR_SIZE="9 9"><KeyFrames><KeyFrame FOCAL_LENGTH="9" PRINCIPAL_POINT="4 4" '
    'ORIENTATION="0 0 0 1" POSITION="0 0 0"/></KeyFrames></Camera>'
)


def repeated(text: str, size: int) -> str:
    return text * (size // len(text))


def numbered(text: str, size: int) -> str:
    return "".join(text.format(index) for index in range(size // len(text.format(size))))


def full(content: str, size: int) -> str:
    """`content` with as much white space behind it as makes it `size` bytes."""
    return content + "\n" * max(size - len(content), 0)


FILES = {
    "dots.toml": lambda: ".".join(["a"] * 50_000) + " = 1\n",
    "head of dots.toml": lambda: f"[{'.'.join(['a'] * 20_000)}]\n",
    "inline dots.toml": lambda: "a = {" + ".".join(["b"] * 20_000) + " = 1}\n",
    "dots behind texts.toml": lambda: "x = '#'\n'#\"'." + ".".join(["b"] * 20_000) + " = 1\n",
    "deep tables.toml": lambda: numbered("[a{0}.b.b.b.b.b.b.b]\n", MEGA // 2),  # Python's own reader takes longest
    "tables.toml": lambda: numbered("[{0}]\n", MEGA),
    "cameras.toml": lambda: numbered(TABLE, MEGA),
    "brackets.toml": lambda: "a = " + "[" * MEGA,
    "quotes.toml": lambda: "a = " + '"\\' * (MEGA // 2),
    "lists.toml": lambda: "a = [" + repeated("[],", MEGA - 10) + "]",
    "large.toml": lambda: full("a = 1\n", 60 * MEGA),
    "spaces.yml": lambda: "%YAML:1.0\n---\na: 1" + " " * 300_000 + "b\n",
    "spaces before a colon.yml": lambda: "%YAML:1.0\n---\na" + " " * 300_000 + "b\n",
    "tags.yml": lambda: "a: " + repeated("!! ", 4 * MEGA) + "\n",
    "quotes.yml": lambda: "a: [" + '"\\' * MEGA + "\n]",
    "quotes and commas.yml": lambda: "a: [" + repeated('","\\', 4 * MEGA) + "\n]",
    "entries.yml": lambda: numbered("a{0}: 1\n", 4 * MEGA),
    "cameras.yml": lambda: numbered(NODE, 4 * MEGA),
    "cameras and much else.yml": lambda: numbered(NODE, 65_000) + numbered("a{0}: 1\n", 3 * MEGA),
    "pieces.yml": lambda: "a: [" + repeated("1,", 4 * MEGA - 10) + "]\n",
    "large.yml": lambda: full("a: 1\n", 60 * MEGA),
    "elements.xml": lambda: "<calibration>" + repeated("<a/>", 60 * MEGA) + "</calibration>",
    "8 MB of elements.xcp": lambda: "<Cameras>" + repeated("<a/>", 8 * MEGA - 50) + "</Cameras>",
    "8 MB of attributes.qca": lambda: "<calibration>" + repeated('<a b=""/>', 8 * MEGA - 50) + "</calibration>",
    "deep.mcal": lambda: "<calibrationProfile>" + repeated("<a>", 8 * MEGA - 50),
    "cameras.xcp": lambda: "<Cameras>" + numbered(CAMERA, 7 * MEGA) + "</Cameras>",
    "large.qca.txt": lambda: full("<calibration/>", 60 * MEGA),
    "large.mcal": lambda: full("<calibrationProfile/>", 60 * MEGA),
    "large.Pmat.cal": lambda: full("1 0 0 0\n", 60 * MEGA),
    "numbers.Pmat.cal": lambda: repeated("1\n", MEGA),
}


@limited
@pytest.mark.parametrize("name", FILES)
def test_reading_is_bounded(tmp_path, name):
    path = tmp_path / name
    path.write_text(FILES[name]())
    if name.endswith(".Pmat.cal"):
        path.rename(tmp_path / "camera1.Pmat.cal")
        path = tmp_path / "camera1.Pmat.cal"
        (tmp_path / "basename1.rad").write_text("K11 = 1\n")
        (tmp_path / "Res.dat").write_text("640 480\n")
    said = read_within("toml", path)
    assert "; expected " in said
    assert len(said) < 400


def test_dots_that_are_no_keys_points_beside_the_cameras_and_comments_are_welcome(tmp_path):
    path = tmp_path / "a.toml"
    path.write_text(
        f'# {"." * 60}\n[c]\nname = "{"a." * 60}"\nother = \'{"." * 60}\'\nlong = """{"." * 60}\n#"."{"." * 60}"""\n'
        + TABLE.format(1).partition("\n")[2]
    )
    assert read_cameras(path).names == ("a." * 60,)
    path.write_text(path.read_text() + "more = 1\na.b.c.d.e.f.g.h.i = 1\n")
    refused("more than 8 parts", read_cameras, path, line=path.read_text().count("\n"))
    path = tmp_path / "a.yml"
    path.write_text(yml(ring()) + "points: [" + "1.25, " * 100_000 + "2] \nlast: 3   # a comment\n")
    assert read_cameras(path).names == ring().names


def rows(count: int, row: dict) -> list[dict]:
    """So many rows with names of their own."""
    return [{**row, "name": f"row {number}"} for number in range(count)]


SEGMENT = {"parent": "head", "offset": [0, 0, 0]}
CHANGES = {
    "markers": (lambda one: {"markers": rows(30_000, one["markers"][0])}, '"markers" has 30000 rows; expected at mos'),
    "segments": (lambda one: {"segments": one["segments"] + rows(40_000, SEGMENT)}, '"segments" has 40013 rows; exp'),
    "capsules": (lambda one: {"capsules": one["capsules"][:1] * 30_000}, '"capsules" has 30000 rows; expected at mo'),
    "numbers": (lambda one: {"notes": [[n, 0.5] for n in range(3_000_000)]}, "has more than 2000000 values; "),
    "aliases": (lambda one: one["markers"][0].update(aliases=[f"alias {n}" for n in range(300_000)]) or {}, "read"),
    "deep": (lambda one: {"notes": json.loads("[" * 900 + "]" * 900)}, "read"),
    "text": (lambda one: {"notes": "é€" * 9_000_000 + "\U0001f600"}, "read"),
}


@limited
@pytest.mark.parametrize("what", CHANGES)
def test_great_marker_sets_and_models(tmp_path, what):
    """A model is read as its marker set is, and then the rest of it."""
    change, said = CHANGES[what]
    path, document = tmp_path / "great.markerset.json", document_of(toy_markerset())
    path.write_text(json.dumps(document | change(document), ensure_ascii=False), encoding="utf-8")
    assert said in read_within("model", path)


HEAD = "frame,camera,x,y,marker\n"
BLOBS = "frame,camera,x,y\n"


@limited
@pytest.mark.parametrize(
    ("kind", "content", "said"),
    [
        ("labels", HEAD + "1,a,2,3,LASI\n" * 300_000, "read"),
        ("labels", HEAD + '"\n",' * 12_000_000, "quote that is not closed; expected"),
        ("labels", HEAD + "1," * 30_000_000, "line of over 1 MB; expected"),
        ("labels", "frame," * 10_000_000, "line of over 1 MB; expected"),
        ("labels", HEAD + "1,a,2,3," + "L" * 200_000, "field larger than field limit"),
        ("labels", HEAD + '"' + "\n" * 60_000_000, "quote that is not closed; expected"),
        ("blobs", BLOBS + "1,cam_1,2,3\n" * 5_000_000, "over 500000 blobs in frame 1; expected"),
        ("blobs", BLOBS + "1," * 30_000_000, "line of over 1 MB; expected"),
        ("blobs", "frame," * 10_000_000, "expected"),
        ("blobs", BLOBS + "".join(f"{frame},cam_1,2,3\n" for frame in range(400_000)), "read"),
    ],
    ids=["many", "quotes", "fields", "header", "name", "newlines", "one frame", "a line", "columns", "long take"],
)
def test_great_labels_and_blobs(tmp_path, kind, content, said):
    path = tmp_path / "great.csv"
    path.write_text(content)
    assert said in read_within(kind, path)
