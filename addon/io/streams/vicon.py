# SPDX-License-Identifier: GPL-3.0-or-later
"""Vicon's DataStream, from Nexus, Shogun, Tracker or Evoke, over TCP.

Not described anywhere, but read from the source of Vicon's own client, DataStream SDK 1.11 (MIT licence): its folders
`ViconCGStream`, the objects, and `ViconCGStreamClient`, who says what when. Points are in mm.
"""

import struct

import numpy as np

from ...core.data.errors import InputError
from .wire import MAX_PARTS, MM_A_METRE, WIRE_WORD, LiveStream, StreamFrame, believed

BLOCK_HEAD = struct.Struct("<II")
# Kinds of blocks: one around all others of a packet, what a client asks for, and what comes of it; format.
OBJECTS, OBJECT_ENUMS, REQUEST_FRAME, CONTENTS = 0x1A2B0001, 100001, 100002, 100004
STREAM_INFO, FRAME_INFO, LABELLED_RECONS, UNLABELLED_RECONS, APPLICATION = 1, 5, 6, 7, 37
WANTED = (STREAM_INFO, FRAME_INFO, LABELLED_RECONS, UNLABELLED_RECONS, APPLICATION, CONTENTS)
TICKS_A_SECOND, PERIOD = 135e6, struct.Struct("<q")  # format: the unit of a frame's period

_RECON = [("radius", "<f8"), ("xyz", "<f8", 3), ("covariance", "<f8", 9), ("id", "<u4")]
_RECONS = {
    LABELLED_RECONS: np.dtype([("subject", "<u4"), ("marker", "<u4"), *_RECON]),
    UNLABELLED_RECONS: np.dtype(_RECON),
}


class ViconStream(LiveStream):
    """A stream of a Vicon program: all reconstructed points, with or without a label."""

    KIND, PORT = "Vicon's DataStream", 801

    def greet(self):
        """Hears what the program has, asks for what is wanted of it, and starts the frames."""
        self.connect_tcp()
        self._points = {kind: np.empty(0, dtype) for kind, dtype in _RECONS.items()}
        self._period = float("nan")
        offered = self._packet().get(OBJECT_ENUMS, b"")
        has = np.frombuffer(offered, "<u4", WIRE_WORD.unpack_from(offered)[0], WIRE_WORD.size)
        wanted = np.array([kind for kind in WANTED if kind in has or kind == CONTENTS], "<u4")
        if UNLABELLED_RECONS not in wanted:
            raise InputError(f"offers no points without labels; expected {self.KIND} with them", self.source)
        self._ask(OBJECT_ENUMS, WIRE_WORD.pack(len(wanted)) + wanted.tobytes())
        self._ask(REQUEST_FRAME, b"\1")

    def _ask(self, kind: int, content: bytes):
        block = BLOCK_HEAD.pack(kind, len(content)) + content
        self.send(BLOCK_HEAD.pack(OBJECTS, len(block)) + block)

    def _packet(self) -> dict[int, bytes]:
        """The blocks of the next packet by their kinds, the last of each."""
        kind, size = BLOCK_HEAD.unpack(self.exactly(BLOCK_HEAD.size))
        if kind != OBJECTS:
            raise InputError(f"sends a packet of the kind {kind:#x}; expected {self.KIND}", self.source)
        return blocks_in(self.exactly(size, begun=True))

    def receive(self) -> StreamFrame | None:
        """Reads a packet: what does not change is not sent again."""
        return self.decoded(self._packet())

    def decoded(self, blocks: dict[int, bytes]) -> StreamFrame | None:
        """The frame that is in the blocks of a packet; None where it holds none."""
        if STREAM_INFO in blocks:
            (ticks,) = PERIOD.unpack_from(blocks[STREAM_INFO])
            self.rate = believed(TICKS_A_SECOND / max(ticks, 1))
            self._period = 1 / self.rate if self.rate else float("nan")
        if APPLICATION in blocks and not self.up:
            self.up = "+Y" if blocks[APPLICATION][:1] == b"\1" else "+Z"
        if FRAME_INFO not in blocks:
            return None
        (number,) = WIRE_WORD.unpack_from(blocks[FRAME_INFO])
        kept = _unchanged(blocks.get(CONTENTS))
        for kind, dtype in _RECONS.items():
            if kind in blocks:
                (count,) = WIRE_WORD.unpack_from(blocks[kind])
                self._points[kind] = np.frombuffer(blocks[kind], dtype, count, WIRE_WORD.size)
            elif kind not in kept:
                self._points[kind] = np.empty(0, dtype)
        xyz, ids = (np.concatenate([part[name] for part in self._points.values()]) for name in ("xyz", "id"))
        return self.of_points(number, number * self._period, xyz, ids, MM_A_METRE)


def blocks_in(content: bytes | bytearray) -> dict[int, bytes]:
    """The blocks of a packet by their kinds, the last of each; struct.error where one ends within its head."""
    found, at = {}, 0
    for _ in range(MAX_PARTS):
        if at >= len(content):
            break
        kind, size = BLOCK_HEAD.unpack_from(content, at)
        at += BLOCK_HEAD.size
        found[kind] = bytes(content[at : at + size])
        at += size
    return found


def _unchanged(contents: bytes | None) -> list[int]:
    """The kinds of blocks that are as in the frame before."""
    if contents is None:
        return []
    (kinds,) = WIRE_WORD.unpack_from(contents)
    at = WIRE_WORD.size + kinds * BLOCK_HEAD.size  # how many there are of each kind
    return np.frombuffer(contents, "<u4", WIRE_WORD.unpack_from(contents, at)[0], at + WIRE_WORD.size).tolist()
