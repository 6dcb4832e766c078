# SPDX-License-Identifier: GPL-3.0-or-later
"""The part of YAML that OpenCV's FileStorage writes: nodes by indentation, `[…]` rows, `!!opencv-matrix`."""

import re
from pathlib import Path

import numpy as np

from ..core.data.errors import InputError

MAX_YAML_DEPTH = 12
KIND = "OpenCV's YAML"

# A text that does not end goes on to the end: looked for again from every quote in it, it would take its square.
_QUOTED = re.compile(r""""(?:[^"\\]|\\.)*"|'[^']*'""")
_PIECE = re.compile(r""""(?:[^"\\]|\\.)*"?|'[^']*'?|[^,\[\]{}]+|[,\[\]{}]""")
_TAGS = re.compile(r"(?:!!\S*\s*)+")


def parse_filestorage(text: str, path: Path) -> dict:
    """The nodes of a file: numbers, texts, lists, dicts, and matrices as arrays (rows, columns).

    Raises InputError with the line where it is anything else.
    """
    lines = _Lines(text, path)
    document = lines.block(0, 0)
    if not isinstance(document, dict):
        raise InputError(f"is a list; expected named nodes of {KIND}", path, 1)
    return document


class _Lines:
    """The lines that say something, each with its number and indentation, and how far they have been read."""

    def __init__(self, text: str, path: Path):
        self.path = path
        self.position = 0
        self.lines: list[tuple[int, int, str]] = []
        for number, line in enumerate(text.splitlines(), 1):
            content = line.strip()
            if content and not content.startswith(("#", "%")) and content not in ("---", "..."):
                self.lines.append((number, len(line) - len(line.lstrip()), content))
        if not self.lines:
            raise InputError(f"has no nodes; expected {KIND}", path)

    def fail(self, message: str) -> InputError:
        index = min(self.position, len(self.lines) - 1)
        return InputError(f"{message}; expected {KIND}", self.path, self.lines[index][0])

    def block(self, indent: int, depth: int) -> object:
        """The node whose lines are indented by `indent` or more: a list when it begins with a dash, else a dict."""
        if depth > MAX_YAML_DEPTH:
            raise self.fail("is nested too deeply")
        indent = self.lines[self.position][1]
        if self.lines[self.position][2].startswith(("- ", "-\t")) or self.lines[self.position][2] == "-":
            return self._list(indent, depth)
        nodes: dict = {}
        while self.position < len(self.lines) and self.lines[self.position][1] >= indent:
            _, here, content = self.lines[self.position]
            entry = _entry(content)
            if here != indent or entry is None:
                raise self.fail(f"has {content[:40]!r} where a node should be")
            self.position += 1
            nodes[_unquoted(entry[0])] = self._value(entry[1], indent, depth)
        return _matrix(nodes, self)

    def _list(self, indent: int, depth: int) -> list:
        items = []
        while self.position < len(self.lines) and self.lines[self.position][1] == indent:
            number, _, content = self.lines[self.position]
            if not content.startswith("-"):
                break
            rest = content[1:].lstrip()
            if _entry(rest) and not rest.startswith(("[", "{")):
                # A dict whose first entry stands beside the dash.
                self.lines[self.position] = (number, indent + len(content) - len(rest), rest)
                items.append(self.block(indent + 1, depth + 1))
            else:
                self.position += 1
                items.append(self._value(rest, indent, depth))
        return items

    def _value(self, text: str, indent: int, depth: int) -> object:
        """What stands behind a name or a dash, on the same line or below it."""
        tags = _TAGS.match(text)
        text = text[tags.end() :] if tags else text
        if text.startswith("#"):
            text = ""
        if not text:
            below = self.position < len(self.lines) and self.lines[self.position]
            deeper = below and (below[1] > indent or (below[1] == indent and below[2].startswith("-")))
            return self.block(indent, depth + 1) if deeper else None
        if text[0] in "[{":
            return self._flow(text)
        return _scalar(text)

    def _flow(self, text: str) -> list:
        """A `[…]` or `{…}` that may go on over several lines, as a flat list of what is in it."""
        parts = [text]
        while parts[-1].count("]") + parts[-1].count("}") == 0 and self.position < len(self.lines):
            parts.append(self.lines[self.position][2])
            self.position += 1
        joined = " ".join(parts)
        if joined[-1] not in "]}":
            raise self.fail("has a list that does not end")
        pieces = (piece.strip() for piece in _PIECE.findall(joined))
        return [_scalar(piece) for piece in pieces if piece and piece not in ",[]{}"]


def _entry(content: str) -> tuple[str, str] | None:
    """A line's name, in its quotes if it has any, and what stands behind the colon; None where it has no name."""
    quoted = _QUOTED.match(content)
    end = quoted.end() if quoted else content.find(":")
    name, colon, value = content[:end], content[end:].lstrip()[:1], content[end:].lstrip()[1:]
    plain = quoted or (name[:1] not in ("", *"#'\"[]{}") and "#" not in name)
    if end <= 0 or not plain or colon != ":" or not (value == "" or value[0].isspace()):
        return None
    return name.strip(), value.strip()


def _matrix(nodes: dict, lines: _Lines) -> object:
    """An array where the nodes are those of a matrix, else the nodes."""
    if not {"rows", "cols", "data"} <= nodes.keys():
        return nodes
    rows, columns, data = nodes["rows"], nodes["cols"], nodes["data"]
    whole = all(isinstance(size, float) and size % 1 == 0 and 0 <= size < 1e6 for size in (rows, columns))
    if not whole or not isinstance(data, list) or not all(isinstance(value, float) for value in data):
        lines.position -= 1
        raise lines.fail("has a matrix that is not rows, cols and numbers")
    if int(rows) * int(columns) != len(data):
        lines.position -= 1
        raise lines.fail(f"has a matrix of {len(data)} numbers for {rows:g}×{columns:g}")
    return np.array(data, dtype=float).reshape(int(rows), int(columns))


def _scalar(text: str) -> float | str:
    """A number where it is one, else a text; `.Nan` and `.Inf` are YAML's."""
    comment = re.search(r"\s#", text) if text[:1] not in "\"'" else None
    text = (text[: comment.start()] if comment else text).strip()
    try:
        return float(text.lower().replace(".nan", "nan").replace(".inf", "inf"))
    except ValueError:
        return _unquoted(text)


def _unquoted(text: str) -> str:
    quoted = len(text) > 1 and text[0] == text[-1] and text[0] in "\"'"
    return text[1:-1] if quoted else text
