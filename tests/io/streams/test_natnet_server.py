# SPDX-License-Identifier: GPL-3.0-or-later
"""Names that are sent on as Motive would: an open client reads them, and whoever asks for nonsense disturbs nobody."""

import random
import socket
import struct
import time
from contextlib import closing

import numpy as np
import pytest

from addon.core.data.errors import InputError
from addon.io.streams import natnet_server
from addon.io.streams.natnet import CONNECT, FRAME_OF_DATA, KEEP_ALIVE, SERVER_INFO, NatNetStream, message
from addon.io.streams.natnet_server import ASK_MODELS, LEAVE, MAX_CLIENTS, MODELS, NOT_KNOWN, NamesServer
from tests.fuzz.wounds import mutated
from tests.io.streams.servers import free_port

SETS = {"ann": {"LASI": "ann:LASI", "RASI": "ann:RASI"}, "b ü": {"LASI": "b ü:LASI"}}
LINE = {
    "frame": 7, "seconds": None, "unnamed": [[0.5, 0.25, 2.0]],
    "markers": {"ann:RASI": [1.0, 2.0, 3.0], "b ü:LASI": [0.1, 0.2, 0.3]},
}  # fmt: skip


@pytest.fixture
def served():
    with NamesServer(f"natnet://127.0.0.1:{free_port()}", SETS) as server:
        yield server


@pytest.fixture
def client(served):
    with closing(socket.socket(socket.AF_INET, socket.SOCK_DGRAM)) as one:
        one.connect(served._socket.getsockname())
        one.settimeout(0.2)
        yield one


def heard(client: socket.socket) -> dict[int, bytes]:
    """What a client has been sent: the content of the last message of each kind."""
    found = {}
    while True:
        try:
            content = client.recv(65535)
        except TimeoutError:
            return found
        kind, size = struct.unpack_from("<HH", content)
        assert size == len(content) - 4
        found[kind] = content[4:]


def test_whoever_says_hello_has_frames_until_they_leave_or_are_silent(served, client, monkeypatch):
    served.tell(LINE)
    client.send(message(KEEP_ALIVE, b""))  # whom nobody knows
    served.tell(LINE)
    assert heard(client) == {}
    client.send(message(CONNECT, b"Ping\0"))
    served.tell(LINE)
    assert heard(client).keys() == {SERVER_INFO, FRAME_OF_DATA}
    client.send(message(LEAVE, b""))
    served.tell(LINE)
    assert heard(client) == {}
    client.send(message(CONNECT, b""))
    served.tell(LINE)
    monkeypatch.setattr(natnet_server, "PATIENCE_S", -1.0)
    heard(client)
    served.tell(LINE)
    assert heard(client) == {} and served.unsent == 0


def test_frames_have_names_where_they_are_and_the_origin_where_they_are_not(served, client):
    client.send(message(CONNECT, b""))
    served.tell(LINE)
    content = heard(client)[FRAME_OF_DATA]
    reader = NatNetStream("natnet://1", ("127.0.0.1", 1), 1.0, "+Y")
    reader.sized = False
    frame = reader.decoded(message(FRAME_OF_DATA, content))
    np.testing.assert_allclose(frame.points, [[1, 2, 3], [0.1, 0.2, 0.3]], rtol=1e-6)
    assert frame.ids.tolist() == [(1 << 16) + 2, (2 << 16) + 1] and frame.number == 7 and frame.seconds == 0
    ann = b"ann\0" + struct.pack("<I6f", 2, 0, 0, 0, 1, 3, -2)
    assert content[4:].startswith(struct.pack("<I", 2) + ann)
    assert struct.pack("<I3f", 1, 0.5, 2.0, -0.25) in content


def test_what_clients_ask_for_is_answered(served, client):
    client.send(message(CONNECT, b""))
    client.send(message(ASK_MODELS, b""))
    client.send(message(2, b"UpAxis\0"))
    client.send(message(77, b""))
    served.tell(LINE)
    told = heard(client)
    assert told[NOT_KNOWN] == b""
    assert told[MODELS].endswith("\0\0\0\0b ü\0\1\0\0\0LASI\0".encode())


def test_nonsense_and_crowds_and_whoever_does_not_listen_disturb_nobody(served, client):
    chance = random.Random(1)
    begin = time.monotonic()
    for _ in range(500):  # of which the client takes none
        for kind in (CONNECT, ASK_MODELS, 2, LEAVE, KEEP_ALIVE):
            client.send(mutated(message(kind, b"Ping\0"), chance)[:60_000])
        served.tell(LINE)
    others = [socket.socket(socket.AF_INET, socket.SOCK_DGRAM) for _ in range(2 * MAX_CLIENTS)]
    for other in others:
        other.sendto(message(CONNECT, b""), served._socket.getsockname())
        served.tell(LINE)
    assert len(served._clients) <= MAX_CLIENTS
    for other in others:
        other.close()
    for _ in range(500):  # to those who are gone
        served.tell(LINE)
    assert time.monotonic() - begin < 20
    served.tell(LINE | {"unnamed": [[0, 0, 0]] * 6000})  # more than fits
    assert served.unsent >= MAX_CLIENTS


def test_clients_from_elsewhere_have_nothing(served):
    hello = message(CONNECT, b"")
    served._hear(hello, ("8.8.8.8", 9))
    assert not served._clients
    served.anywhere = True
    served._hear(hello, ("127.0.0.1", 9))
    assert served._clients


def test_an_address_that_cannot_be_served_is_told():
    for where, words in (
        ("127.0.0.1", "is no address of a stream; expected"),
        ("qtm://127.0.0.1", "is nothing that names are sent by; expected natnet://HOST"),
        ("natnet://8.8.8.8", "outside of this machine's own network"),
        ("natnet://10.254.253.252", r"cannot be listened at \(.+\); expected an address of this machine, and a port"),
    ):
        with pytest.raises(InputError, match=words):
            NamesServer(where, SETS)
    where = f"natnet://127.0.0.1:{free_port()}"
    with NamesServer(where, SETS), pytest.raises(InputError, match="a port that is free"):
        NamesServer(where, SETS)
