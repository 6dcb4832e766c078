# SPDX-License-Identifier: GPL-3.0-or-later
"""What all streams have in common: their frames, sockets with a deadline, and one sentence for whatever goes wrong."""

import socket
import struct
from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from select import select
from time import monotonic
from typing import ClassVar, Self, TypeVar

import numpy as np

from ...core.data.errors import InputError, JobError
from ...core.data.takes import MIN_RATE_HZ
from ..world import up_rotation

PATIENCE_S = 5.0  # physical: slower than any camera, quicker than a person who thinks that all has stopped
# What no stream sends; memory.
MAX_PACKET_BYTES = 1 << 24  # a frame of tens of thousands of points
MAX_FRAME_POINTS = 20_000  # nobody wears a hundredth of them
MM_A_METRE = 1000.0
WIRE_WORD = struct.Struct("<I")  # format: most numbers of most wires
MAX_DATAGRAM = 65_535  # format: what fits into one
MAX_PARTS = 1000  # of a packet, each with a head: some dozen kinds are known
# What cannot be; physical.
ROOM_M, AGES_S = 1e5, 1e12  # farther from the origin, or later by the sender's clock
MAX_STREAM_HZ = 1e4  # frames a second, of points in a room; the last seconds of them are kept
# Frames by which a packet may come late on any network; one from before that is the sender, who began anew.
LATE_FRAMES = 100
# Kept by the system while nobody reads: a second of most streams. Memory.
QUEUED_BYTES = 1 << 22

Answer = TypeVar("Answer")


def believed(rate: float) -> float | None:
    """Frames a second, as a sender says or shows; None where they cannot be so many or so few."""
    return rate if MIN_RATE_HZ <= rate <= MAX_STREAM_HZ else None


@dataclass(frozen=True, eq=False)
class StreamFrame:
    """One frame of a stream, as it came."""

    number: int  # the sender's own
    seconds: float  # when it was taken, by the sender's clock; NaN where it does not say
    points: np.ndarray  # (P, 3) m, z up: all that were seen, whether the sender names them or not
    ids: np.ndarray  # (P,) the sender's numbers of their trajectories, NO_POINT where it has none


class LiveStream(ABC):
    """A stream of frames that was opened by its address: an iterator, and a context manager that closes it.

    Numbers of frames ascend, unless the sender begins anew. `next` waits `patience` s for a frame at most, then there
    is a JobError; there is an InputError for whatever is no frame. It ends where the sender ends.

    rate  frames a second, where the sender says
    late  how many frames were left out, because they came twice or after a later one
    """

    KIND: ClassVar[str]
    PORT: ClassVar[int]

    def __init__(self, source: str, address: tuple[str, int], patience: float, up: str = ""):
        self.source, self.address, self.patience = source, address, patience
        self.up = up  # such as "+Y"; empty where the sender may say
        self.rate: float | None = None
        self.late = 0
        self.sockets: list[socket.socket] = []
        self._last: int | None = None
        self._deadline = 0.0

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object):
        for one in self.sockets:
            one.close()

    def __iter__(self) -> Self:
        return self

    def __next__(self) -> StreamFrame:
        try:
            return self._told(self._new_frame)
        except EOFError:
            if self._last is None:
                words = "ended before its first frame; expected a program that measures, or plays a take"
                raise JobError(words, self.source) from None
            raise StopIteration from None

    @property
    def behind(self) -> bool:
        """Whether more has come already, so that who names frames as they come had better take the next."""
        return bool(select(self.sockets, (), (), 0)[0])

    @abstractmethod
    def greet(self):
        """Says hello, and that all frames are wanted."""

    @abstractmethod
    def receive(self) -> StreamFrame | None:
        """Reads a packet: a frame, or None where it holds none; EOFError where there will be no more."""

    def start(self) -> Self:
        """The stream, once its sender has answered; closed where it does not."""
        try:
            self._told(self.greet)
        except BaseException as error:
            self.__exit__()
            if isinstance(error, EOFError):
                raise InputError(f"closes the connection; expected {self.KIND}", self.source) from None
            raise
        return self

    def _told(self, work: Callable[[], Answer]) -> Answer:
        """What `work` gives within the stream's patience; whatever is wrong with the network or a packet is told."""
        self._deadline = monotonic() + self.patience
        try:
            return work()
        except TimeoutError:
            words = f"has sent nothing that is new for {self.patience:g} s"
            raise JobError(f"{words}; expected {self.KIND} that measures, or plays a take", self.source) from None
        except OSError as error:
            words = f"cannot be reached ({error.strerror or error})"
            raise InputError(f"{words}; expected {self.KIND} at port {self.address[1]}", self.source) from None
        except (struct.error, ValueError):
            words = "sends a packet that is cut short or makes no sense"
            raise InputError(f"{words}; expected {self.KIND}", self.source) from None

    def _new_frame(self) -> StreamFrame:
        while True:
            frame = self.receive()
            if frame is None:
                continue
            if self._last is not None and self._last - LATE_FRAMES < frame.number <= self._last:
                self.late += 1
                continue
            self._last = frame.number
            return frame

    def patience_left(self) -> float:
        """How many s are left to wait; TimeoutError where there are none."""
        left = self._deadline - monotonic()
        if left <= 0:
            raise TimeoutError
        return left

    def connect_tcp(self):
        """Opens a connection."""
        one = socket.create_connection(self.address, self.patience_left())
        self.sockets.append(one)
        one.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)

    def send(self, content: bytes):
        """Sends bytes over the connection."""
        self.sockets[0].settimeout(self.patience_left())
        self.sockets[0].sendall(content)

    def exactly(self, size: int, begun: bool = False) -> bytearray:
        """The next bytes of the connection.

        Where it is closed: EOFError, or JobError where a packet had `begun`, or its part.
        """
        if size > MAX_PACKET_BYTES:
            words = f"sends a packet of over {MAX_PACKET_BYTES >> 20} MB"
            raise InputError(f"{words}; expected {self.KIND}", self.source)
        content = bytearray()  # grows with what comes, whatever is announced
        while len(content) < size:
            self.sockets[0].settimeout(self.patience_left())
            part = self.sockets[0].recv(min(size - len(content), MAX_DATAGRAM))
            if not part and (begun or content):
                raise JobError("broke off within a packet; expected a whole one", self.source)
            if not part:
                raise EOFError
            content += part
        return content

    def open_udp(self, port: int = 0, group: str = ""):
        """Opens a socket for datagrams; with a group, for those that are sent to it on the host's network."""
        one = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.sockets.append(one)
        one.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, QUEUED_BYTES)
        if group:
            one.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        one.bind(("", port))
        if group:
            with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as way:
                way.connect(self.address)  # sends nothing, but tells which of our addresses is on that network
                ours = way.getsockname()[0]
            both = socket.inet_aton(group) + socket.inet_aton(ours)
            one.setsockopt(socket.IPPROTO_IP, socket.IP_ADD_MEMBERSHIP, both)

    def datagram(self, most: float) -> bytes:
        """The next datagram of the host, whoever else sends some; empty where none came in so many s."""
        end = monotonic() + most
        while (left := min(self.patience_left(), end - monotonic())) > 0:
            for one in select(self.sockets, (), (), left)[0]:
                content, (host, _) = one.recvfrom(MAX_DATAGRAM)
                # A program on this machine sends to groups from its address on the network.
                if host == self.address[0] or (self.address[0].startswith("127.") and one is not self.sockets[0]):
                    return content
        return b""

    def of_points(self, number: int, seconds: float, points: np.ndarray, ids: np.ndarray, per_m=1.0) -> StreamFrame:
        """A frame of points (P, 3) in the sender's axes and unit; those that are no numbers were not seen."""
        seen = np.isfinite(points).all(axis=1)
        points, ids = points[seen].astype(float) / per_m, ids[seen].astype(np.int64)
        if abs(seconds) > AGES_S or np.abs(points).max(initial=0) > ROOM_M or len(points) > MAX_FRAME_POINTS:
            words = f"sends a frame {number} with a point or a time that cannot be, or with {len(points)} points"
            raise InputError(f"{words}; expected at most {MAX_FRAME_POINTS} points in a room", self.source)
        if self.up not in ("", "+Z"):
            points = points @ up_rotation(self.up).T
        return StreamFrame(number, seconds, points, ids)
