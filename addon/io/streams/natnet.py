# SPDX-License-Identifier: GPL-3.0-or-later
"""OptiTrack's NatNet, versions 3.0 to 4.x, from Motive: over UDP, to this machine alone or to a group.

Described at https://docs.optitrack.com/developer-tools/natnet-sdk and by OptiTrack's own clients. Metres, y up unless
Motive streams with z up, which it does not say.
"""

import socket
import struct
from collections.abc import Callable
from time import monotonic

import numpy as np

from ...core.data.errors import InputError
from ...core.data.takes import NO_POINT
from .wire import WIRE_WORD, LiveStream, StreamFrame

MESSAGE_HEAD = struct.Struct("<HH")
CONNECT, SERVER_INFO, FRAME_OF_DATA, KEEP_ALIVE = 0, 1, 7, 10  # format: kinds of messages
# What either side says of itself: a name, its version, and NatNet's; then Motive its clock, port, and group.
SENDER, TRANSPORT = struct.Struct("<256s4B4B"), struct.Struct("<QHB4s")
DATA_PORT, DATA_GROUP = 1511, "239.255.42.99"
# Motive forgets a client that was silent for some seconds.
KEEP_ALIVE_S = 1.0
SECONDS = struct.Struct("<8xd")  # behind two time codes

_POINT, _BODY = np.dtype(("<f4", 3)), np.dtype("V38")
LABELLED_MARKER = np.dtype([("id", "<u4"), ("xyz", "<f4", 3), ("size", "<f4"), ("flags", "<u2"), ("residual", "<f4")])
# Flags of a marker: the cameras did not see it, did, a rigid body says where it was, and it is one of an asset.
CAMERAS_MISSED, CAMERAS_SAW, BY_MODEL, HAS_MODEL = 1, 2, 4, 8


def message(kind: int, content: bytes) -> bytes:
    """A datagram; struct.error where that is too much for one."""
    return MESSAGE_HEAD.pack(kind, len(content)) + content


class NatNetStream(LiveStream):
    """A stream of Motive: all markers that its cameras saw, of its assets or not."""

    KIND, PORT = "Motive with NatNet 3 or 4", 1510

    def greet(self):
        """Says hello until Motive answers with its version, and where its frames go."""
        self.up = self.up or "+Y"
        self.open_udp()
        self._alive = -KEEP_ALIVE_S
        hello = SENDER.pack(b"Mocap Autolabel", 1, 0, 0, 0, 4, 0, 0, 0)
        content = b""
        while content[:2] != SERVER_INFO.to_bytes(2, "little"):
            if monotonic() - self._alive >= KEEP_ALIVE_S:
                self._tell(CONNECT, hello)
            content = self.datagram(KEEP_ALIVE_S)
        version = SENDER.unpack_from(content, MESSAGE_HEAD.size)[5:7]
        if not (3, 0) <= version < (5, 0):
            words = f"speaks NatNet {version[0]}.{version[1]}"
            raise InputError(f"{words}; expected {self.KIND}", self.source)
        self.sized = version >= (4, 1)  # whether lists say how many bytes they have
        at = MESSAGE_HEAD.size + SENDER.size
        port, shared, group = DATA_PORT, True, socket.inet_aton(DATA_GROUP)
        if len(content) >= at + TRANSPORT.size:
            _, port, shared, group = TRANSPORT.unpack_from(content, at)
        if shared:
            self.open_udp(port, socket.inet_ntoa(group))

    def _tell(self, kind: int, content: bytes = b""):
        self.sockets[0].sendto(message(kind, content), self.address)
        self._alive = monotonic()

    def receive(self) -> StreamFrame | None:
        """Reads a datagram, and lets Motive know now and then that somebody does."""
        if monotonic() - self._alive > KEEP_ALIVE_S:
            self._tell(KEEP_ALIVE)
        content = self.datagram(KEEP_ALIVE_S)
        if content[:2] != FRAME_OF_DATA.to_bytes(2, "little"):
            return None
        return self.decoded(content)

    def decoded(self, content: bytes) -> StreamFrame:
        """The frame that is in a message of its kind."""
        (number,) = WIRE_WORD.unpack_from(content, MESSAGE_HEAD.size)
        lists = _Lists(content, MESSAGE_HEAD.size + WIRE_WORD.size, self.sized)
        lists.skip(lists.marker_set)
        others = lists.read(_POINT)
        lists.read(_BODY)
        lists.skip(lists.skeleton)
        if self.sized:
            lists.skip(lists.skeleton)  # assets, of which nothing needs to be known
        markers = lists.read(LABELLED_MARKER)
        for _ in ("force plates", "other devices"):
            lists.skip(lists.device)
        (seconds,) = SECONDS.unpack_from(content, lists.at)
        if not len(markers):  # which are all, those of `others` too where it has any
            return self.of_points(number, seconds, others, np.full(len(others), NO_POINT))
        flags = markers["flags"]
        seen = (flags & CAMERAS_MISSED == 0) & ((flags & CAMERAS_SAW != 0) | (flags & BY_MODEL == 0))
        return self.of_points(number, seconds, markers["xyz"][seen], markers["id"][seen])


class _Lists:
    """Goes over the lists of a frame, one after the other; ValueError or struct.error where there is no more."""

    def __init__(self, content: bytes, at: int, sized: bool):
        self.content, self.at, self.sized = content, at, sized

    def word(self) -> int:
        (number,) = WIRE_WORD.unpack_from(self.content, self.at)
        self.at += WIRE_WORD.size
        return number

    def read(self, dtype: np.dtype) -> np.ndarray:
        count, size = self.word(), self.word() if self.sized else 0
        found = np.frombuffer(self.content, dtype, count, self.at)
        self.at += size if self.sized else found.nbytes
        return found

    def skip(self, each: Callable[[], None]):
        """Goes behind a list, by what it says or else by each of its parts."""
        count = self.word()
        if self.sized:
            self.go(self.word())
            return
        for _ in range(count):
            each()

    def go(self, size: int):
        self.at += size

    def marker_set(self):
        self.at = self.content.index(b"\0", self.at) + 1
        self.go(self.word() * _POINT.itemsize)

    def skeleton(self):
        self.go(WIRE_WORD.size)
        self.go(self.word() * _BODY.itemsize)

    def device(self):
        self.go(WIRE_WORD.size)
        for _ in range(self.word()):
            self.go(self.word() * WIRE_WORD.size)
