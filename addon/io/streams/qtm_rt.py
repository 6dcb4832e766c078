# SPDX-License-Identifier: GPL-3.0-or-later
"""Qualisys Track Manager's real-time protocol, versions 1.19 to 1.25, over TCP with little-endian numbers.

Described at https://github.com/qualisys/Real-Time-Protocol-Documentation. Points are in mm.
"""

import re
import struct

import numpy as np

from ...core.data.errors import InputError, JobError
from ...core.data.takes import NO_POINT
from ..world import SIGNED_AXES
from .wire import MAX_PARTS, MM_A_METRE, LiveStream, StreamFrame, believed

PACKET_HEAD, FRAME_HEAD, PART_HEAD = struct.Struct("<II"), struct.Struct("<qII"), struct.Struct("<III4x")
NEWEST_MINOR, OLDEST_MINOR = 25, 19  # format: of the protocol's version 1
QTM_ERROR, QTM_COMMAND, QTM_XML, QTM_DATA, QTM_NO_MORE, QTM_EVENT = 0, 1, 2, 3, 4, 6  # format: kinds of packets
CALIBRATING, SHUTTING_DOWN = 6, 12  # format: events

# Parts of a frame: 3D, without labels, with residuals, and both.
_XYZ, _ID, _RESIDUAL = ("xyz", "<f4", 3), ("id", "<i4"), ("residual", "<f4")
_POINTS = {
    1: np.dtype([_XYZ]),
    2: np.dtype([_XYZ, _ID]),
    9: np.dtype([_XYZ, _RESIDUAL]),
    10: np.dtype([_XYZ, _ID, _RESIDUAL]),
}


class QtmStream(LiveStream):
    """A stream of Qualisys Track Manager: all points, with or without a label."""

    KIND, PORT = "Qualisys Track Manager", 22223

    def greet(self):
        """Agrees on a version, asks for the parameters, and starts the frames."""
        self.connect_tcp()
        self._answer()
        for minor in range(NEWEST_MINOR, OLDEST_MINOR - 1, -1):
            kind, answer = self._ask(f"Version 1.{minor}")
            if kind == QTM_COMMAND and answer.lower().startswith("version set"):
                break
        else:
            words = f"speaks no version of its protocol that is known ({_quoted(answer)})"
            raise InputError(f"{words}; expected 1.{OLDEST_MINOR} to 1.{NEWEST_MINOR}", self.source)
        try:
            self.rate = believed(float(self._parameter("General", "Frequency")))
        except ValueError:
            self.rate = None
        axis = self.up or self._parameter("3D", "AxisUpwards")
        self.up = axis if axis in SIGNED_AXES else "+Z"
        self._say("StreamFrames AllFrames 3D 3DNoLabels")

    def _say(self, command: str):
        content = command.encode() + b"\0"
        self.send(PACKET_HEAD.pack(PACKET_HEAD.size + len(content), QTM_COMMAND) + content)

    def _ask(self, command: str) -> tuple[int, str]:
        self._say(command)
        return self._answer()

    def _answer(self) -> tuple[int, str]:
        """The next packet that answers a command, and its text."""
        while True:
            kind, content = self._packet()
            if kind in (QTM_ERROR, QTM_COMMAND, QTM_XML):
                return kind, _text(content)

    def _parameter(self, part: str, what: str) -> str:
        """One of a part of the parameters, the first of its name; empty where there is none."""
        kind, answer = self._ask(f"GetParameters {part}")
        if kind != QTM_XML:
            words = f"has no {part} parameters ({_quoted(answer)})"
            raise JobError(f"{words}; expected an open project and calibrated cameras", self.source)
        found = re.search(rf"<{what}>\s*([^<\s]*)", answer)
        return found[1] if found else ""

    def _packet(self) -> tuple[int, bytearray]:
        size, kind = PACKET_HEAD.unpack(self.exactly(PACKET_HEAD.size))
        if size < PACKET_HEAD.size:
            raise InputError(f"sends a packet of {size} bytes; expected {self.KIND}", self.source)
        return kind, self.exactly(size - PACKET_HEAD.size, begun=True)

    def receive(self) -> StreamFrame | None:
        """Reads a packet: a frame, or an event that may end the stream, or neither."""
        kind, content = self._packet()
        if kind == QTM_DATA:
            return self.decoded(content)
        if kind == QTM_ERROR:
            words = f"sends no frames ({_quoted(_text(content))})"
            raise JobError(f"{words}; expected {self.KIND} that measures, or plays a take", self.source)
        event = content[0] if kind == QTM_EVENT and content else 0
        if event == SHUTTING_DOWN or (kind == QTM_NO_MORE and self._last is not None):
            raise EOFError
        if event == CALIBRATING:
            raise JobError("changes its cameras; expected them to stay as they were at the start", self.source)
        return None

    def decoded(self, content: bytes | bytearray) -> StreamFrame | None:
        """The frame that is in a data packet behind its head; None where it holds no points."""
        time, number, parts = FRAME_HEAD.unpack_from(content)
        seconds, at = time / 1e6, FRAME_HEAD.size
        points: list[np.ndarray] = []
        ids: list[np.ndarray] = []
        if parts > MAX_PARTS:
            raise ValueError
        for _ in range(parts):
            size, kind, count = PART_HEAD.unpack_from(content, at)
            if size < PART_HEAD.size:
                raise ValueError
            if kind in _POINTS:
                own = memoryview(content)[at : at + size]  # else each might be as large as all of the packet
                part = np.frombuffer(own, _POINTS[kind], count, PART_HEAD.size)
                points.append(part["xyz"])
                ids.append(part["id"] if "id" in (part.dtype.names or ()) else np.full(count, NO_POINT))
            at += size
        if not points:
            return None
        return self.of_points(number, seconds, np.concatenate(points), np.concatenate(ids), MM_A_METRE)


def _text(content: bytearray) -> str:
    return content.rstrip(b"\0").decode("utf-8", "replace")


def _quoted(text: str) -> str:
    """How a text begins, by the signs that people can read."""
    return "".join(sign if sign.isprintable() else " " for sign in text[:80])
