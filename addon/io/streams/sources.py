# SPDX-License-Identifier: GPL-3.0-or-later
"""Opens a stream by its address, such as `qtm://192.168.0.10`."""

import ipaddress
import socket
from urllib.parse import SplitResult, urlsplit

from ...core.data.errors import InputError
from .natnet import NatNetStream
from .qtm_rt import QtmStream
from .vicon import ViconStream
from .wire import PATIENCE_S, LiveStream

STREAMS: dict[str, type[LiveStream]] = {"qtm": QtmStream, "natnet": NatNetStream, "vicon": ViconStream}
EXPECTED = "expected qtm://HOST, natnet://HOST or vicon://HOST"


def open_stream(source: str, up: str = "", patience: float = PATIENCE_S, anywhere: bool = False) -> LiveStream:
    """The stream of a program on this machine or its own network; `anywhere`, also of one elsewhere.

    `up` is the axis of the sender's world that points up, one of x y z -x
    -y -z, where that is known better than from the stream. Opening it, and each frame after that, takes `patience` s
    at most; the system may look longer for a name that it does not know.

    Raises InputError for an address that is none, or where no such program answers, and JobError where it sends
    nothing that is wanted.
    """
    kind, address = address_of(source, anywhere)
    axis = up.upper() if up[:1] in ("", "-") else f"+{up.upper()}"
    return kind(source, address, patience, axis).start()


def address_of(source: str, anywhere: bool = False) -> tuple[type[LiveStream], tuple[str, int]]:
    """Which program's stream an address is of, its host's number and its port; InputError as `open_stream`."""
    try:
        parts = urlsplit(source)
        port, kind = parts.port, STREAMS.get(parts.scheme)
    except ValueError:
        kind = None
    if kind is None or port == 0 or not parts.hostname or _says_more(parts):
        raise InputError(f"is no address of a stream; {EXPECTED}", source)
    return kind, (_host(parts.hostname, source, anywhere), port or kind.PORT)


def _says_more(parts: SplitResult) -> bool:
    """Whether something stands behind the host and its port, or before them."""
    return bool(parts.path.strip("/") or parts.query or parts.fragment or parts.username)


def _host(name: str, source: str, anywhere: bool) -> str:
    """The host's address; InputError where it is unknown, or outside of this machine's own network."""
    try:
        host = str(socket.getaddrinfo(name, None, socket.AF_INET, socket.SOCK_STREAM)[0][4][0])
    except (OSError, UnicodeError):
        raise InputError("is a host that is not known; expected its name or address", source) from None
    if not anywhere and not ipaddress.ip_address(host).is_private:  # which this machine's own are, too
        words = f"is outside of this machine's own network ({host})"
        raise InputError(f"{words}; expected a private address, such as 192.168.0.10", source)
    return host
