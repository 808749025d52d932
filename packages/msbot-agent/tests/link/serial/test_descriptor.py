from __future__ import annotations

import asyncio
import errno
import os
import socket
from collections.abc import Iterator

import pytest

from msbot_agent.link.serial.pty import READ_OCTETS, DescriptorTransport


class Recorder(asyncio.Protocol):
    """Keeps what its transport calls."""

    def __init__(self) -> None:
        self.data: asyncio.Queue[bytes] = asyncio.Queue()
        self.calls: asyncio.Queue[str] = asyncio.Queue()
        self.lost: asyncio.Future[Exception | None] = asyncio.get_running_loop().create_future()

    def data_received(self, data: bytes) -> None:
        self.data.put_nowait(data)

    def pause_writing(self) -> None:
        self.calls.put_nowait("pause")

    def resume_writing(self) -> None:
        self.calls.put_nowait("resume")

    def connection_lost(self, exc: Exception | None) -> None:
        self.lost.set_result(exc)


@pytest.fixture
def ends() -> Iterator[tuple[socket.socket, socket.socket]]:
    ours, other = socket.socketpair()
    with ours, other:
        other.setblocking(False)
        yield ours, other


Ends = tuple[socket.socket, socket.socket]


async def test_octets_go_both_ways_and_long_ones_in_pieces(ends: Ends) -> None:
    ours, other = ends
    protocol = Recorder()
    transport = DescriptorTransport(ours.fileno(), protocol)
    other.send(bytes(READ_OCTETS + 1))
    assert [len(await protocol.data.get()) for _ in range(2)] == [READ_OCTETS, 1]
    transport.write(b"")
    transport.write(b"abc")
    assert other.recv(10) == b"abc"
    transport.close()
    assert await protocol.lost is None


async def test_what_the_other_end_does_not_take_waits_within_limits(ends: Ends) -> None:
    ours, other = ends
    protocol = Recorder()
    transport = DescriptorTransport(ours.fileno(), protocol)
    transport.set_write_buffer_limits(high=1000)
    sent = 0
    while transport.get_write_buffer_size() <= 1000:
        transport.write(bytes([sent % 251]) * 777)
        sent += 1
    assert protocol.calls.get_nowait() == "pause"
    transport.write(b"more")
    assert protocol.calls.empty()
    came = b""
    while len(came) < sent * 777 + 4:
        came += await asyncio.get_running_loop().sock_recv(other, 100_000)
    assert came == b"".join(bytes([number % 251]) * 777 for number in range(sent)) + b"more"
    assert await protocol.calls.get() == "resume"
    assert transport.get_write_buffer_size() == 0
    assert not asyncio.get_running_loop().remove_writer(ours.fileno()), "nothing is left that would wake the loop up"
    transport.abort()
    await protocol.lost


async def test_nothing_is_carried_after_the_end(ends: Ends) -> None:
    ours, other = ends
    protocol = Recorder()
    transport = DescriptorTransport(ours.fileno(), protocol)
    assert not transport.is_closing()
    transport.abort()
    transport.abort()
    assert transport.is_closing()
    transport.write(b"x")
    other.send(b"y")
    assert await protocol.lost is None
    assert protocol.data.empty()
    with pytest.raises(BlockingIOError):
        other.recv(1)


async def test_the_other_end_closes(ends: Ends) -> None:
    ours, other = ends
    protocol = Recorder()
    DescriptorTransport(ours.fileno(), protocol)
    other.close()
    assert await protocol.lost is None


@pytest.mark.parametrize("verb", ["read", "write"])
async def test_an_error_ends_it_and_is_handed_on(ends: Ends, verb: str, monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(*_: object) -> int:
        raise OSError(errno.EIO, "Input/output error")

    ours, other = ends
    protocol = Recorder()
    transport = DescriptorTransport(ours.fileno(), protocol)
    with monkeypatch.context() as patch:
        patch.setattr(os, verb, fail)
        if verb == "read":
            other.send(b"x")
        else:
            transport.write(b"x")
        error = await protocol.lost
    assert isinstance(error, OSError)
    assert error.errno == errno.EIO


async def test_an_error_while_octets_wait_ends_it_too(ends: Ends, monkeypatch: pytest.MonkeyPatch) -> None:
    answers: list[OSError] = [BlockingIOError(errno.EAGAIN, "busy"), BlockingIOError(errno.EAGAIN, "busy")]

    def write(*_: object) -> int:
        raise answers.pop() if answers else BrokenPipeError(errno.EPIPE, "broken")

    ours, _ = ends
    protocol = Recorder()
    transport = DescriptorTransport(ours.fileno(), protocol)
    with monkeypatch.context() as patch:
        patch.setattr(os, "write", write)
        transport.write(b"x")
        assert isinstance(await protocol.lost, BrokenPipeError)
    assert os.get_blocking(ours.fileno()) is False


async def test_a_false_alarm_is_no_end(ends: Ends, monkeypatch: pytest.MonkeyPatch) -> None:
    ours, other = ends
    protocol = Recorder()
    transport = DescriptorTransport(ours.fileno(), protocol)
    transport._read()
    other.send(b"x")
    assert await protocol.data.get() == b"x"
    transport.abort()
    await protocol.lost


async def test_what_is_taken_in_small_pieces_comes_whole(ends: Ends) -> None:
    ours, other = ends
    for end in ends:
        end.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, 1)  # the smallest that there is
    transport = DescriptorTransport(ours.fileno(), Recorder())
    sent = bytes(number % 251 for number in range(300_000))
    transport.write(sent)
    came = b""
    while len(came) < len(sent):
        came += await asyncio.get_running_loop().sock_recv(other, 1000)
    assert came == sent
    transport.abort()


@pytest.mark.parametrize(
    ("limits", "pauses_above", "resumes_at"),
    [({}, 65_536, 16_384), ({"high": 1000}, 1000, 250), ({"high": 1000, "low": 10}, 1000, 10), ({"high": 0}, 0, 0)],
)
async def test_writing_pauses_above_one_limit_and_goes_on_at_the_other(
    ends: Ends, limits: dict[str, int], pauses_above: int, resumes_at: int
) -> None:
    ours, _other = ends
    protocol = Recorder()
    transport = DescriptorTransport(ours.fileno(), protocol)
    transport.set_write_buffer_limits(**limits)
    while transport.get_write_buffer_size() == 0:  # until the system takes no more
        transport.write(b"x" * 100_000)
        while not protocol.calls.empty():
            protocol.calls.get_nowait()
    transport._waiting[:] = b"x" * pauses_above
    transport._is_paused = False
    transport.write(b"")
    assert protocol.calls.empty()
    transport.write(b"x")
    assert protocol.calls.get_nowait() == "pause"
    _other.recv(1_000_000)
    # As much is taken as there is room for: what is left decides.
    transport._waiting[:] = b"x" * (resumes_at + 1)
    taken = _taking(transport, 0)
    assert taken == resumes_at + 1
    assert protocol.calls.empty()
    assert _taking(transport, 1) == resumes_at
    assert protocol.calls.get_nowait() == "resume"
    assert _taking(transport, 0) == resumes_at
    assert protocol.calls.empty(), "it is said once"
    transport._waiting[:] = b"x" * (pauses_above + 1)
    transport.write(b"x")
    assert protocol.calls.get_nowait() == "pause", "and all of it again"
    transport.abort()


def _taking(transport: DescriptorTransport, octets: int) -> int:
    """Have the system take so many; returns what waits then."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(os, "write", lambda _descriptor, _waiting: octets)
        transport._write_more()
    return transport.get_write_buffer_size()
