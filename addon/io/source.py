# SPDX-License-Identifier: GPL-3.0-or-later
"""Opening what the user named: whatever the file system answers, the user reads one sentence."""

import codecs
import hashlib
import json
import os
import re
import stat
from collections.abc import Iterator
from contextlib import contextmanager
from io import BufferedReader, FileIO, StringIO
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self

import numpy as np

from ..core.data.errors import InputError

if TYPE_CHECKING:
    from xml.etree.ElementTree import Element


# Bytes beyond which a text is another file than is meant; memory.
# of JSON: parsed, a value takes up to a hundred times the letters that it was written with, and no file of ours has a
# tenth of these. Long texts, such as packed arrays, cost no more than their letters
MAX_JSON_VALUES = 2_000_000
MAX_TEXT_BYTES = 64 * 1024 * 1024  # a calibration or a marker set is a few kilobytes to a few megabytes (camera masks)
# parsed, a byte of XML takes up to 100; calibrations of hundreds of cameras have far fewer bytes, also with the masks
# of their images, which only XML holds
MAX_XML_BYTES = 8 * 1024 * 1024
MAX_CALIBRATION_BYTES = 1024 * 1024  # the same without masks: a byte of TOML takes up to 350


# Longer marks first: the UTF-32 one begins with the UTF-16 one.
_MARKS = (
    (codecs.BOM_UTF8, "utf-8"),
    (codecs.BOM_UTF32_LE, "utf-32-le"),
    (codecs.BOM_UTF32_BE, "utf-32-be"),
    (codecs.BOM_UTF16_LE, "utf-16-le"),
    (codecs.BOM_UTF16_BE, "utf-16-be"),
)


def open_binary(path: Path) -> BufferedReader:
    """The file at `path`, open for reading; InputError when there is none, it is no file or may not be read.

    Whatever is read goes through here, also what we wrote ourselves: anybody may have put something in its place.
    A disk that fails later on is an InputError, too.
    """
    path = Path(path)
    with _readable(path):
        kind = path.stat().st_mode
        if stat.S_ISDIR(kind):
            raise InputError("is a folder; expected a file", path)
        if not stat.S_ISREG(kind):
            # Opening a pipe waits for a writer that may never come, and two readings of one differ.
            raise InputError("is a pipe or a device; expected an ordinary file", path)
        return BufferedReader(_NamedFile(path, opener=open_at_once))


class _NamedFile(FileIO):
    """A file whose name is in what goes wrong while it is read: the system names those that it opens."""

    def readinto(self, buffer):
        with _readable(self.name):
            return super().readinto(buffer)

    def readall(self):
        with _readable(self.name):
            return super().readall()

    def seek(self, *place):
        with _readable(self.name):
            return super().seek(*place)


@contextmanager
def _readable(path: Path) -> Iterator[None]:
    """Turns what the system says of reading a file into an InputError."""
    try:
        yield
    except FileNotFoundError:
        raise InputError("there is no such file; expected the path of an existing file", path) from None
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or error
        raise InputError(f"cannot be read ({reason}); expected a readable file", path) from None


def open_at_once(path: str, flags: int) -> int:
    """An opener, as `open` takes one, that waits for nobody at a pipe that was put there meanwhile."""
    return os.open(path, flags | getattr(os, "O_NONBLOCK", 0), 0o666)


class BytesOnDisk:
    """The content of an open file, of which parts are read when they are asked for; a context manager.

    A file that is mapped into memory instead would end the process when it is cut off meanwhile.
    """

    def __init__(self, path: Path):
        """Raises InputError where it is missing, unreadable or empty."""
        self.path, self.file = path, open_binary(path)
        self.size = self.file.seek(0, 2)
        self.state = (self.size, os.fstat(self.file.fileno()).st_mtime_ns)  # which tells it from itself once changed
        if not self.size:
            self.file.close()
            raise InputError("is empty; expected a file with content", path)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object):
        self.file.close()

    def __len__(self) -> int:
        return self.size

    def __getitem__(self, part: slice) -> bytes:
        """The bytes from start to stop; InputError where they cannot be read."""
        start, stop, _ = part.indices(self.size)
        self.file.seek(start)
        content = self.file.read(max(stop - start, 0))
        if len(content) < stop - start:
            raise InputError("became shorter while it was read; expected a whole file", self.path)
        return content


def read_bytes(path: Path, limit: int | None = None) -> bytes:
    """The whole content; InputError when it is missing, unreadable, empty or over `limit` bytes."""
    with open_binary(path) as file:
        content = file.read() if limit is None else file.read(limit + 1)
    if not content:
        raise InputError("is empty; expected a file with content", path)
    if limit is not None and len(content) > limit:
        raise InputError(f"is larger than {limit >> 20} MB; expected a file of this format", path)
    return content


def read_text(path: Path, kind: str, limit: int = MAX_TEXT_BYTES) -> str:
    """The text of a small file in UTF-8, or UTF-16 or -32 with its mark; InputError when it is no text.

    `kind` names the format in the error, such as "a camera calibration"; `limit` is the most bytes that one has.
    """
    return decode(read_bytes(path, limit), path, kind)


def decode(content: bytes, path: Path, kind: str) -> str:
    """`content` as text; old Windows files that are not UTF-8 are taken as Windows-1252."""
    for mark, encoding in _MARKS:
        if content.startswith(mark):
            try:
                return content[len(mark) :].decode(encoding)
            except UnicodeDecodeError:
                raise InputError(f"is damaged text; expected {kind}", path) from None
    if b"\0" in content:
        raise InputError(f"is a binary file; expected {kind}", path)
    try:
        return content.decode("utf-8")
    except UnicodeDecodeError:
        return windows_text(content)


# What Windows-1252 has where Latin-1 has control characters; format. Five bytes mean nothing in it.
_WINDOWS = {code: letter for code in range(0x80, 0xA0) if (letter := bytes([code]).decode("cp1252", "ignore"))}


def windows_text(content: bytes) -> str:
    """Text as Windows wrote it in western Europe and America before UTF-8, of any bytes."""
    return content.decode("latin-1").translate(_WINDOWS)


def read_xml(path: Path, kind: str) -> "Element":
    """The root of an XML file with all it holds, in whatever encoding; InputError with the line where it breaks.

    Declarations of entities are refused: no calibration has them, and a few nested ones fill the memory.
    """
    from xml.etree import ElementTree

    with _well_formed(path, kind):
        return ElementTree.fromstring(_xml_text(path, kind))


def root_of_xml(path: Path, kind: str) -> str:
    """The name of an XML file's root; no more is read of it than that takes. InputErrors as of `read_xml`."""
    from xml.etree import ElementTree

    with _well_formed(path, kind):
        _, root = next(ElementTree.iterparse(StringIO(_xml_text(path, kind)), ["start"]))
        return root.tag


def _xml_text(path: Path, kind: str) -> str:
    text = read_text(path, kind, MAX_XML_BYTES)
    if text.startswith("<?xml"):
        # The declared encoding is that of the bytes, not of the decoded text.
        start, end, rest = text.partition("?>")
        text = "\n" * start.count("\n") + rest if end else text
    if "<!ENTITY" in text or "<!DOCTYPE" in text:
        raise InputError(f"declares a document type; expected {kind} as plain XML", path)
    return text


@contextmanager
def _well_formed(path: Path, kind: str) -> Iterator[None]:
    from xml.etree import ElementTree

    try:
        yield
    except ElementTree.ParseError as error:
        raise InputError(f"is not well-formed XML; expected {kind}", path, error.position[0]) from None
    except (ValueError, RecursionError):
        raise InputError(f"is not XML that can be read; expected {kind}", path) from None


# A camera's key is `matrix` or `cameras.0.matrix`. Every dot nests a table, and the parser goes through all of them.
MAX_KEY_PARTS = 8
_WORDS = re.compile(
    r'''"""(?:[^"\\]|\\.|"(?!""))*(?:""")?|"(?:[^"\\\n]|\\.)*"?|'''
    r"""'''(?:[^']|'(?!''))*(?:''')?|'[^'\n]*'?|#[^\n]*""",
    re.DOTALL,
)


def toml_document(path: Path, kind: str) -> dict:
    """The content of a TOML file; InputError with the line where it is none.

    `kind` names what it should be in the error, such as "a camera calibration".
    """
    import tomllib

    text = read_text(path, kind, MAX_CALIBRATION_BYTES)
    _refuse_depth(text, path, kind)
    try:
        return tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        line = re.search(r"at line (\d+)", str(error))
        where = int(line.group(1)) if line else text.count("\n") + 1
        raise InputError(f"is not valid TOML; expected {kind}", path, where) from None
    except (RecursionError, ValueError):
        raise InputError(f"is not TOML that can be read; expected {kind}", path) from None


def _refuse_depth(text: str, path: Path, kind: str):
    """InputError with the line of a key of more parts than any file has; texts and comments have none."""
    plain = _WORDS.sub(lambda found: "s" + "\n" * found.group().count("\n"), text)
    line = 1
    for piece in re.split(r"([=,\[\]{}\n])", plain):
        if piece.count(".") >= MAX_KEY_PARTS:
            raise InputError(f"has a key of more than {MAX_KEY_PARTS} parts; expected {kind}", path, line)
        line += piece == "\n"


def numbers(text: str | None, count: int, what: str, path: Path, line: int = 0) -> np.ndarray:
    """The `count` finite numbers in `text`, split by spaces or commas; InputError naming `what` otherwise."""
    text = text or ""
    fields = text.replace(",", " ").split()
    if len(fields) != count:
        raise InputError(f"{what} has {len(fields)} numbers; expected {count}", path, line)
    try:
        values = [float(field) for field in fields]
    except ValueError:
        raise InputError(f"{what} is {text.strip()[:60]!r}; expected {count} numbers", path, line) from None
    if not all(abs(value) <= 1e12 for value in values):
        raise InputError(f"{what} is {text.strip()[:60]!r}; expected finite numbers", path, line)
    return np.array(values)


def digest(path: Path) -> str:
    """SHA-256 of what a file holds; InputError where it cannot be read."""
    with open_binary(path) as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()


def is_still(path: Path, sha256: object) -> bool:
    """Whether a file holds what had that digest; InputError where it cannot be read."""
    now = digest(path)
    return sha256 in (now, hashlib.sha256(bytes.fromhex(now)).hexdigest())  # earlier versions digested it once more


def read_json(path: Path, kind: str) -> Any:
    """The content of a JSON file; InputError with the line where it is none, and where it would fill the memory.

    `kind` names the format in the error, such as "a marker set".
    """
    text = read_text(path, kind)
    # Every value but the first stands behind one of these signs.
    if sum(map(text.count, ",[{")) > MAX_JSON_VALUES:
        raise InputError(f"has more than {MAX_JSON_VALUES} values; expected {kind}", path)
    try:
        return json.loads(text)
    except json.JSONDecodeError as error:
        raise InputError(f"is not valid JSON ({error.msg}); expected {kind}", path, error.lineno) from None
    except (ValueError, RecursionError):
        raise InputError(f"is not JSON that can be read; expected {kind}", path) from None
