# SPDX-License-Identifier: GPL-3.0-or-later
"""Names sent on as Motive would send them: a NatNet server, of which most engines have a client.

Of version 3.1, which clients of 4.x read too. Metres, y up; to each client alone, wherever it asks from.
"""

import ipaddress
import socket
import struct
from collections.abc import Mapping, Sequence
from contextlib import suppress
from time import monotonic
from typing import Self

import numpy as np

from ...core.data.errors import InputError
from ..world import up_rotation
from . import natnet
from .natnet import LABELLED_MARKER, MESSAGE_HEAD, SENDER, TRANSPORT, NatNetStream, message
from .sources import address_of
from .wire import MAX_DATAGRAM, PATIENCE_S, WIRE_WORD

SERVED_VERSION = 3, 1  # format: without the sizes of lists
ASK_MODELS, MODELS, LEAVE, NOT_KNOWN = 4, 5, 9, 100  # format: kinds of messages
MAX_CLIENTS = 16  # of one stream, and what is heard of them between two frames; memory
SET_BITS = 16  # format: of a labelled marker's number, behind that of its set


class NamesServer:
    """Sends the lines of `live` to whoever asks for them; a context manager, which closes it.

    Nobody is waited for: what cannot be sent at once is left out, and counted in `unsent`.
    """

    def __init__(self, where: str, sets: Mapping[str, Mapping[str, str]], anywhere: bool = False):
        """At an address of this machine, natnet://HOST; `anywhere`, also to clients outside of its own network.

        `sets` are the markers of each subject, and what lines call them. InputError where the address is none of ours.
        """
        kind, address = address_of(where, anywhere)
        if kind is not NatNetStream:
            raise InputError("is nothing that names are sent by; expected natnet://HOST", where)
        self.sets, self.anywhere, self.unsent = sets, anywhere, 0
        self._clients: dict[tuple[str, int], float] = {}  # when each was heard last
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.setblocking(False)
        try:
            self._socket.bind(address)
        except OSError as error:
            self._socket.close()
            words = f"cannot be listened at ({error.strerror})"
            raise InputError(f"{words}; expected an address of this machine, and a port that is free", where) from None

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object):
        self._socket.close()

    def tell(self, line: Mapping):
        """Answers who has asked for something since the last line, and sends this one to all of them."""
        with suppress(OSError):  # nobody, or one who is gone
            for _ in range(MAX_CLIENTS):
                self._hear(*self._socket.recvfrom(MAX_DATAGRAM))
        begin = monotonic() - PATIENCE_S
        self._clients = {client: heard for client, heard in self._clients.items() if heard > begin}
        if self._clients:
            content = self._frame(line)
            for client in self._clients:
                self._send(natnet.FRAME_OF_DATA, content, client)

    def _hear(self, content: bytes, client: tuple[str, int]):
        """Does what a client asks for; nothing where that is none, or comes from elsewhere."""
        if not self.anywhere and not ipaddress.ip_address(client[0]).is_private:
            return
        kind = int.from_bytes(content[: MESSAGE_HEAD.size // 2], "little")
        welcome = client in self._clients or (kind == natnet.CONNECT and len(self._clients) < MAX_CLIENTS)
        if len(content) < MESSAGE_HEAD.size or not welcome:
            return
        if kind == LEAVE:
            del self._clients[client]
            return
        self._clients[client] = monotonic()
        if kind == natnet.CONNECT:
            said = SENDER.pack(b"Mocap Autolabel", 1, 0, 0, 0, *SERVED_VERSION, 0, 0)
            ticks = 10**9  # a second; no frame says any
            said += TRANSPORT.pack(ticks, natnet.DATA_PORT, False, socket.inet_aton(natnet.DATA_GROUP))
            self._send(natnet.SERVER_INFO, said, client)
        elif kind == ASK_MODELS:
            self._send(MODELS, packed_models({name: list(own) for name, own in self.sets.items()}), client)
        elif kind != natnet.KEEP_ALIVE:
            self._send(NOT_KNOWN, b"", client)

    def _send(self, kind: int, content: bytes, client: tuple[str, int]):
        try:
            self._socket.sendto(message(kind, content), client)
        except (OSError, struct.error):  # it takes no more, is gone, or this is more than fits into any datagram
            self.unsent += 1

    def _frame(self, line: Mapping) -> bytes:
        """A frame of all names, and of the other points; a marker that is not there is in its set at the origin."""
        named, sets, markers = line["markers"], {}, []
        for number, (name, own) in enumerate(self.sets.items(), 1):
            sets[name] = _y_up([named.get(called, (0, 0, 0)) for called in own.values()])
            for at, called in enumerate(own.values(), 1):
                if called in named:
                    flags = natnet.CAMERAS_SAW | natnet.HAS_MODEL
                    markers.append((number << SET_BITS | at, sets[name][at - 1], 0, flags, 0))
        labelled = np.array(markers, LABELLED_MARKER)
        return packed_frame(line["frame"], line["seconds"] or 0.0, sets, _y_up(line["unnamed"]), labelled)


def _y_up(points: Sequence[Sequence[float]]) -> np.ndarray:
    return np.reshape(points, (-1, 3)) @ up_rotation("+Y")


def packed_frame(
    number: int, seconds: float, sets: Mapping[str, np.ndarray], others: np.ndarray, markers: np.ndarray
) -> bytes:
    """The content of a message: places (M, 3) m of marker sets, other points (P, 3) m, and `markers` of that kind."""
    own = [_text(name) + WIRE_WORD.pack(len(places)) + places.astype("<f4").tobytes() for name, places in sets.items()]
    none = WIRE_WORD.pack(0)  # of rigid bodies, skeletons, force plates and devices
    content = [WIRE_WORD.pack(number), WIRE_WORD.pack(len(own)), *own]
    content += [WIRE_WORD.pack(len(others)), others.astype("<f4").tobytes(), none, none]
    content += [WIRE_WORD.pack(len(markers)), markers.tobytes(), none, none]
    # No time code, no stamps of the cameras' clock; then no flags, and the end.
    return b"".join([*content, struct.pack("<IId3Q", 0, 0, seconds, 0, 0, 0), bytes(6)])


def packed_models(sets: Mapping[str, Sequence[str]]) -> bytes:
    """The content of a message that says what marker sets there are, and how their markers are called."""
    own = [_text(name) + WIRE_WORD.pack(len(names)) + b"".join(map(_text, names)) for name, names in sets.items()]
    return WIRE_WORD.pack(len(own)) + b"".join(WIRE_WORD.pack(0) + one for one in own)


def _text(text: str) -> bytes:
    return text.replace("\0", " ").encode() + b"\0"
