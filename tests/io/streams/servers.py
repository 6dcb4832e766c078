# SPDX-License-Identifier: GPL-3.0-or-later
"""Servers that play a take as Qualisys, OptiTrack or Vicon programs send it: for tests, and to try a reader by hand."""

import socket
import struct
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import suppress
from itertools import chain, count, cycle
from threading import Thread

import numpy as np

from addon.io.streams.natnet import (
    BY_MODEL,
    CAMERAS_MISSED,
    CAMERAS_SAW,
    DATA_GROUP,
    HAS_MODEL,
    LABELLED_MARKER,
    SENDER,
    TRANSPORT,
    message,
)
from addon.io.streams.wire import StreamFrame


def frames_of_points(xyz: np.ndarray, rate: float) -> list[StreamFrame]:
    """The frames of points (T, P, 3) m, of which trajectory p has the number 100 + p."""
    found = []
    for number, points in enumerate(np.asarray(xyz), 1):
        seen = np.isfinite(points).all(axis=1)
        found.append(StreamFrame(number, number / rate, points[seen], np.flatnonzero(seen) + 100))
    return found


def there_and_back(xyz: np.ndarray, rate: float) -> Iterator[StreamFrame]:
    """The same for ever, there and back, numbered on and on."""
    frames = frames_of_points(xyz, rate)
    for number, frame in zip(count(1), cycle(chain(frames, frames[-2:0:-1])), strict=False):
        yield StreamFrame(number, number / rate, frame.points, frame.ids)


class Server:
    """Plays frames to whoever connects, from a thread; a context manager, whose `source` is the address for a reader.

    rate   frames a second; None for as fast as they are taken
    wound  what every packet goes through before it is sent
    """

    scheme = ""

    def __init__(
        self, frames: Iterable[StreamFrame], rate: float | None = None, wound: Callable[[bytes], bytes] = bytes
    ):
        self.frames, self.rate, self.wound, self.ended = frames, rate, wound, False
        self.socket = self.listening()
        self.port = self.socket.getsockname()[1]
        self.source = f"{self.scheme}://127.0.0.1:{self.port}"

    def __enter__(self):
        self.thread = Thread(target=self._run, daemon=True)
        self.thread.start()
        return self

    def __exit__(self, *_):
        self.ended = True
        self.thread.join(10)
        self.socket.close()

    def _run(self):
        self.socket.settimeout(0.05)
        while not self.ended:
            with suppress(OSError):  # nobody yet, or gone
                self.serve()

    def listening(self) -> socket.socket:
        return socket.create_server(("127.0.0.1", 0))

    def serve(self):
        """Waits for somebody for a moment, and plays to him."""
        connection, _ = self.socket.accept()
        with connection:
            connection.settimeout(10)
            connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            self.talk(connection)

    def talk(self, connection: socket.socket):
        raise NotImplementedError

    def playing(self) -> Iterator[StreamFrame]:
        """The frames in their time."""
        start = time.monotonic()
        for sent, frame in enumerate(self.frames, 1):
            if self.ended:
                return
            if self.rate is not None:
                time.sleep(max(0.0, start + sent / self.rate - time.monotonic()))
            yield frame


def read(connection: socket.socket, size: int) -> bytes:
    content = connection.recv(size, socket.MSG_WAITALL) if size else b""
    if len(content) < size:
        raise ConnectionError
    return content


class QtmServer(Server):
    """Qualisys Track Manager; `labelled` points of each frame, the first, are sent as those with labels.

    Versions of the protocol later than 1.`minor` it does not know.
    """

    scheme = "qtm"

    def __init__(self, *args, labelled: int = 0, minor: int = 25, up="+Z", **options):
        self.labelled, self.minor, self.up = labelled, minor, up
        super().__init__(*args, **options)

    def talk(self, connection: socket.socket):
        def send(kind: int, content: bytes):
            connection.sendall(self.wound(struct.pack("<II", 8 + len(content), kind) + content))

        send(1, b"QTM RT Interface connected\0")
        while True:
            size, _ = struct.unpack("<II", read(connection, 8))
            command, *words = read(connection, size - 8).rstrip(b"\0").decode().lower().split()
            if command == "version":
                known = int(words[0].partition(".")[2]) <= self.minor
                send(1, b"Version set to " + words[0].encode() + b"\0" if known else b"Version NOT supported\0")
            elif command == "getparameters":
                content = "".join(self.parameters(word) for word in words)
                send(2, f"<QTM_Parameters_Ver_1.25>{content}</QTM_Parameters_Ver_1.25>\0".encode())
            elif words[0] != "stop":
                send(6, b"\3")
                for frame in self.playing():
                    parts = [self.part(word, frame) for word in words[1:]]
                    head = struct.pack("<qII", round(frame.seconds * 1e6), frame.number, len(parts))
                    send(3, head + b"".join(parts))
                send(4, b"")

    def parameters(self, word: str) -> str:
        if word == "3d":
            return f"<The_3D><AxisUpwards>{self.up}</AxisUpwards></The_3D>"
        return f"<General><Frequency>{self.rate or 100:g}</Frequency></General>"

    def part(self, word: str, frame: StreamFrame) -> bytes:
        mm, kinds = (frame.points * 1000).astype("<f4"), {"3d": 1, "3dnolabels": 2, "3dres": 9, "3dnolabelsres": 10}
        with_id, with_residual = "nolabels" in word, word.endswith("res")
        which = slice(self.labelled, None) if with_id else slice(self.labelled)
        fields = [("xyz", "<f4", 3), *[("id", "<i4")] * with_id, *[("residual", "<f4")] * with_residual]
        cells = np.zeros(len(mm[which]), np.dtype(fields))
        cells["xyz"] = mm[which]
        if with_id:
            cells["id"] = frame.ids[which]
        return struct.pack("<IIIhh", 16 + cells.nbytes, kinds[word], len(cells), 0, 0) + cells.tobytes()


class ViconServer(Server):
    """A Vicon program; from the third frame on every other one says that its points are as before."""

    scheme = "vicon"

    def talk(self, connection: socket.socket):
        def packet(**blocks: bytes):
            content = b"".join(struct.pack("<II", int(kind[1:]), len(one)) + one for kind, one in blocks.items())
            connection.sendall(self.wound(struct.pack("<II", 0x1A2B0001, len(content)) + content))

        def numbers(kinds: Iterable[int]) -> bytes:
            return struct.pack(f"<I{len(kinds)}I", len(kinds), *kinds)

        packet(_100001=numbers([1, 2, 5, 6, 7, 37]))
        for _ in ("what is wanted", "that it begins"):
            read(connection, struct.unpack("<II", read(connection, 8))[1])
        rate = self.rate or 100
        start = {"_1": struct.pack("<q", round(135e6 / rate)), "_37": b"\1"}
        recon = [("radius", "<f8"), ("xyz", "<f8", 3), ("covariance", "<f8", 9), ("id", "<u4")]
        for at, frame in enumerate(self.playing()):
            labels = [("subject", "<u4"), ("marker", "<u4")]
            both = np.zeros(1, labels + recon), np.zeros(len(frame.points) - 1, recon)
            y_up = frame.points[:, [0, 2, 1]] * [1000, 1000, -1000]
            for cells, which in zip(both, (slice(1), slice(1, None)), strict=True):
                cells["xyz"], cells["id"] = y_up[which], frame.ids[which]
            frame_info = struct.pack("<I", frame.number)
            if at % 2 and at > 1:
                packet(_100004=struct.pack("<III", 1, 7, 1) + numbers([6, 7]), _5=frame_info)
                continue
            labelled, unlabelled = (struct.pack("<I", len(one)) + one.tobytes() for one in both)
            first = start if at == 0 else {}
            packet(_100004=struct.pack("<I", 0) + numbers([]), **first, _5=frame_info, _6=labelled, _7=unlabelled)


def free_port() -> int:
    """A port for datagrams that nobody has."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as free:
        free.bind(("", 0))
        return free.getsockname()[1]


class NatNetServer(Server):
    """Motive, to whoever says hello; or, where it is `shared`, to a group. It has two of every kind of asset."""

    scheme = "natnet"

    def __init__(self, *args, version: tuple[int, int] = (4, 1), shared: bool = False, legacy=False, **options):
        self.version, self.shared, self.legacy = version, shared, legacy
        super().__init__(*args, **options)

    def listening(self) -> socket.socket:
        one = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        one.bind(("127.0.0.1", 0))
        one.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_IF, socket.inet_aton("127.0.0.1"))
        self.data_port = free_port()
        return one

    def serve(self):
        content, client = self.socket.recvfrom(65535)
        if content[:2] != b"\0\0":
            return
        info = SENDER.pack(b"Motive", *self.version, 0, 0, *self.version, 0, 0)
        info += TRANSPORT.pack(10**7, self.data_port, self.shared, socket.inet_aton(DATA_GROUP))
        self.socket.sendto(self.message(1, info), client)
        time.sleep(0.1)  # until it listens
        where = (DATA_GROUP, self.data_port) if self.shared else client
        for frame in self.playing():
            self.socket.sendto(self.message(7, self.frame(frame)), where)
            if self.rate is None:
                time.sleep(1e-4)  # as much as whoever reads can take

    def message(self, kind: int, content: bytes) -> bytes:
        return self.wound(message(kind, content))

    def frame(self, frame: StreamFrame) -> bytes:
        y_up = frame.points[:, [0, 2, 1]] * [1, 1, -1]
        markers = np.zeros(len(y_up) + 1, LABELLED_MARKER)  # the last one was not seen
        markers["id"][:-1], markers["xyz"][:-1] = frame.ids, y_up
        markers["flags"] = np.where(np.arange(len(markers)) % 2, CAMERAS_SAW | 0x10, CAMERAS_SAW | HAS_MODEL)
        markers["flags"][-1] = CAMERAS_MISSED | BY_MODEL
        body = struct.pack("<I8fH", 1, *range(8), 1)
        bodies = struct.pack("<II", 1, 2) + body * 2
        asset = struct.pack("<II", 1, 1) + body + struct.pack("<II4fHf", 1, 7, 1, 2, 3, 4, 2, 0.1)
        device = struct.pack("<IIIfI2f", 1, 2, 1, 5.0, 2, 6.0, 7.0)
        sets = [b"all\0" + struct.pack("<I3f", 1, 1, 1, 1), b"actor\0" + struct.pack("<I6f", 2, 1, 1, 1, 1, 1, 1)]
        labelled, sized = markers[:0] if self.legacy else markers, self.version >= (4, 1)
        lists = [(sets, 2), ([y_up.astype("<f4").tobytes()], len(y_up)), ([body] * 2, 2), ([bodies] * 2, 2)]
        lists += [*[([asset] * 2, 2)] * sized, ([labelled.tobytes()], len(labelled)), *[([device] * 2, 2)] * 2]
        content = struct.pack("<I", frame.number)
        for parts, many in lists:
            whole = b"".join(parts)
            content += struct.pack("<II", many, len(whole))[: 4 + 4 * sized] + whole
        return content + struct.pack("<IId3Q", 0, 0, frame.seconds, 0, 0, 0) + bytes(8 * sized + 6)
