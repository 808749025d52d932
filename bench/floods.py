"""What strangers without any rights can send to a master, at a rate: each kind of flood is a process of its own.

Every packet of the UDP flood comes from an address that was not seen before (on Linux any user may bind to all of
127.0.0.0/8); a third are garbage, a third questions for an agent, a third logins. A flood ends by itself.
"""

from __future__ import annotations

import multiprocessing
import os
import random
import socket
import ssl
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from typing import Any

from msbot_xrce.messages import SESSION_NONE, CreateClient, GetInfo, Header, encode_message

LONGEST_S = 300.0
"""No flood goes on for longer."""
STEP_S = 0.01
"""How often a flood sends what is due."""
OPEN = 200
"""Connections that a flood leaves open, the oldest of which it closes for the next one."""


@dataclass(frozen=True)
class Flood:
    """One kind of flood."""

    name: str
    per_s: float
    send: Callable[[], object]
    """Sends once; what it returns is kept open for a while."""


def udp(port: int, per_s: float) -> Flood:
    """Datagrams from ever new addresses."""
    return Flood("UDP", per_s, partial(_datagram, port, random.Random(1)))


def tcp(port: int, per_s: float) -> Flood:
    """Connections to the robot's TCP link, each with some octets that are no packet."""
    return Flood("TCP", per_s, partial(_connection, port, b"\xff\xff" + bytes(40)))


def http(port: int, per_s: float) -> Flood:
    """Requests for the page, each over a connection of its own; every second one is none."""
    return Flood("HTTP", per_s, partial(_request, port, random.Random(2)))


def tls(port: int, per_s: float) -> Flood:
    """Negotiations of TLS, each over a connection of its own, without a request after it."""
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
    context.check_hostname, context.verify_mode = False, ssl.CERT_NONE
    return Flood("TLS", per_s, partial(_hello, port, context))


@contextmanager
def flooding(floods: list[Flood], core: int) -> Iterator[dict[str, Any]]:
    """While they flood from that processor; gives how many each has sent, by name."""
    over = multiprocessing.Event()
    counts = {one.name: multiprocessing.Value("q", 0) for one in floods}
    running = [
        multiprocessing.Process(target=_run, args=(one, core, over, counts[one.name]), daemon=True) for one in floods
    ]
    for process in running:
        process.start()
    try:
        yield counts
    finally:
        over.set()
        for process in running:
            process.join(10.0)
            if process.is_alive():
                process.kill()


def _run(flood: Flood, core: int, over: Any, count: Any) -> None:  # noqa: ANN401 - an event and a number
    os.sched_setaffinity(0, {core})
    began, sent, is_open = time.monotonic(), 0, []
    while not over.is_set() and (passed := time.monotonic() - began) < LONGEST_S:
        due = int(passed * flood.per_s)
        if due - sent > flood.per_s * 0.2:  # it cannot keep up: what it has missed is not made up for in one burst
            began += (due - sent) / flood.per_s
            continue
        for _ in range(due - sent):
            try:
                kept = flood.send()
            except OSError:
                kept = None
            sent += 1
            if isinstance(kept, socket.socket):
                is_open.append(kept)
                if len(is_open) > OPEN:
                    is_open.pop(0).close()
        count.value = sent
        time.sleep(STEP_S)


def _datagram(port: int, chance: random.Random) -> None:
    host = f"127.{chance.randrange(1, 255)}.{chance.randrange(256)}.{chance.randrange(1, 255)}"
    kind = chance.randrange(3)
    if kind == 0:
        packet = chance.randbytes(40)
    elif kind == 1:
        packet = encode_message(Header(SESSION_NONE, 0, 0, None), [GetInfo(1, 0xFFFD, 1)], pad_end=False)
    else:
        key = chance.randrange(1, 1 << 32)
        packet = encode_message(Header(SESSION_NONE, 0, 0, None), [CreateClient(key, 0x81, 512)], pad_end=False)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as one:
        one.setblocking(False)
        one.bind((host, 0))
        one.sendto(packet, ("127.0.0.1", port))


def _connection(port: int, octets: bytes) -> socket.socket:
    one = _connected(port)
    one.setblocking(False)
    one.send(octets)
    return one


def _request(port: int, chance: random.Random) -> socket.socket:
    one = _connected(port)
    right = f"GET /login HTTP/1.1\r\nHost: 127.0.0.1:{port}\r\n\r\n".encode()
    one.send(chance.randbytes(60) if chance.randrange(2) else right)
    one.setblocking(False)
    return one


def _hello(port: int, context: ssl.SSLContext) -> socket.socket:
    one = _connected(port)
    try:
        return context.wrap_socket(one)
    except BaseException:
        one.close()
        raise


def _connected(port: int) -> socket.socket:
    one = socket.socket()
    one.settimeout(1.0)
    try:
        one.connect(("127.0.0.1", port))
    except BaseException:
        one.close()
        raise
    return one
