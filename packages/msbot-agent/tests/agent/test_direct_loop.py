"""Readers that are called by the selector: in order with everything else that a loop does."""

from __future__ import annotations

import asyncio
import contextvars
import os
import signal
import socket
import sys
import threading
from collections.abc import Iterator
from typing import Any

import pytest

from msbot_agent.process.direct_loop import DirectLoop, gathering_of
from msbot_agent.process.end_signals import run_to_end
from msbot_agent.process.timer_grid import LONGEST_PAUSE_S, TimerGridLoop

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="elsewhere it is asyncio's own")
WAIT_S = 10.0


@pytest.fixture
def pair() -> Iterator[tuple[socket.socket, socket.socket]]:
    ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_DGRAM)
    with ours, theirs:
        ours.setblocking(False)
        theirs.setblocking(False)
        yield ours, theirs


def run(main: Any) -> Any:
    return run_to_end(asyncio.wait_for(main, WAIT_S), DirectLoop)


def turns_of(loop: asyncio.AbstractEventLoop) -> list[None]:
    """Grows by one with every turn of the loop's own queue."""
    turns: list[None] = []
    run_once = loop._run_once  # type: ignore[attr-defined]  # only the test counts turns

    def counted() -> None:
        turns.append(None)
        run_once()

    loop._run_once = counted  # type: ignore[attr-defined]
    return turns


def test_programs_run_in_it() -> None:
    async def main() -> tuple[bool, bool]:
        loop = asyncio.get_running_loop()
        return isinstance(loop, DirectLoop), gathering_of(loop) is not None

    assert run_to_end(main()) == (True, True)


def test_many_datagrams_are_read_without_a_turn_of_the_loop(pair: tuple[socket.socket, socket.socket]) -> None:
    ours, theirs = pair

    async def main() -> None:
        loop = asyncio.get_running_loop()
        done = loop.create_future()
        found: list[bytes] = []

        def read() -> None:
            found.append(ours.recv(100))
            if len(found) == 100:
                done.set_result(None)
            else:
                theirs.send(b"%d" % len(found))

        loop.add_reader(ours, read)
        turns = turns_of(loop)
        theirs.send(b"0")
        await done
        assert found == [b"%d" % number for number in range(100)]
        assert len(turns) < 10
        loop.remove_reader(ours)

    run(main())


def test_what_a_reader_puts_into_the_queue_or_on_the_clock_comes_at_once(
    pair: tuple[socket.socket, socket.socket],
) -> None:
    ours, theirs = pair

    async def main() -> list[str]:
        loop = asyncio.get_running_loop()
        done = loop.create_future()
        found: list[str] = []

        def read() -> None:
            ours.recv(100)
            if found:
                return
            found.append("read")
            loop.call_soon(found.append, "soon")
            loop.call_later(0.001, done.set_result, None)
            theirs.send(b"again")

        loop.add_reader(ours, read)
        theirs.send(b"first")
        await done
        loop.remove_reader(ours)
        return found

    assert run(main()) == ["read", "soon"]


def test_a_timer_comes_while_datagrams_follow_each_other_without_end(
    pair: tuple[socket.socket, socket.socket],
) -> None:
    ours, theirs = pair

    async def main() -> None:
        loop = asyncio.get_running_loop()

        def read() -> None:
            theirs.send(ours.recv(100))

        loop.add_reader(ours, read)
        theirs.send(b"round and round")
        await asyncio.sleep(0.02)
        assert loop.remove_reader(ours)

    run(main())


def test_a_thread_and_a_signal_are_heard_while_it_waits_for_datagrams(
    pair: tuple[socket.socket, socket.socket],
) -> None:
    ours, _ = pair

    async def main() -> None:
        loop = asyncio.get_running_loop()
        loop.add_reader(ours, ours.recv, 100)
        heard = asyncio.Event()
        loop.add_signal_handler(signal.SIGUSR1, heard.set)
        threading.Timer(0.01, loop.call_soon_threadsafe, (os.kill, os.getpid(), signal.SIGUSR1)).start()
        await heard.wait()
        loop.remove_signal_handler(signal.SIGUSR1)
        loop.remove_reader(ours)

    run(main())


def test_a_loop_that_a_reader_stops_stops(pair: tuple[socket.socket, socket.socket]) -> None:
    ours, theirs = pair
    loop = DirectLoop()
    try:
        loop.add_reader(ours, loop.stop)
        theirs.send(b"stop")
        alarm = loop.call_later(WAIT_S, pytest.fail, "it went on")
        loop.run_forever()
        alarm.cancel()
        loop.remove_reader(ours)
    finally:
        loop.close()


def test_an_error_of_a_reader_is_reported_and_the_loop_goes_on(pair: tuple[socket.socket, socket.socket]) -> None:
    ours, theirs = pair

    async def main() -> None:
        loop = asyncio.get_running_loop()
        done = loop.create_future()
        problems: list[dict[str, Any]] = []
        loop.set_exception_handler(lambda _, context: problems.append(context))

        def read() -> None:
            if ours.recv(100) == b"bad":
                raise ValueError("bad")
            done.set_result(None)

        loop.add_reader(ours, read)
        theirs.send(b"bad")
        theirs.send(b"good")
        await done
        assert [str(one["exception"]) for one in problems] == ["bad"]
        loop.remove_reader(ours)

    run(main())


@pytest.mark.parametrize("error", [KeyboardInterrupt, SystemExit])
def test_what_ends_a_program_comes_out_of_a_reader(
    error: type[BaseException], pair: tuple[socket.socket, socket.socket]
) -> None:
    ours, theirs = pair
    loop = DirectLoop()

    def read() -> None:
        raise error

    try:
        loop.add_reader(ours, read)
        theirs.send(b"end")
        with pytest.raises(error):
            loop.run_forever()
        loop.remove_reader(ours)
    finally:
        loop.close()


def test_a_reader_that_another_one_removes_is_not_called(pair: tuple[socket.socket, socket.socket]) -> None:
    ours, theirs = pair

    async def main() -> list[str]:
        loop = asyncio.get_running_loop()
        called: list[str] = []

        def read(name: str, this: socket.socket, other: socket.socket) -> None:
            this.recv(100)
            called.append(name)
            loop.remove_reader(other)

        loop.add_reader(ours, read, "ours", ours, theirs)
        loop.add_reader(theirs, read, "theirs", theirs, ours)
        ours.send(b"to them")
        theirs.send(b"to us")
        await asyncio.sleep(0.01)
        for one in pair:
            loop.remove_reader(one)
        return called

    assert len(run(main())) == 1


def test_a_reader_sees_the_context_in_which_it_was_added(pair: tuple[socket.socket, socket.socket]) -> None:
    ours, theirs = pair
    who = contextvars.ContextVar("who", default="nobody")

    async def main() -> str:
        loop = asyncio.get_running_loop()
        done: asyncio.Future[str] = loop.create_future()
        who.set("adder")

        def read() -> None:
            ours.recv(100)
            done.set_result(who.get())

        loop.add_reader(ours, read)
        theirs.send(b"who?")
        found = await done
        loop.remove_reader(ours)
        return found

    assert run(main()) == "adder"


def test_a_reader_stays_while_a_writer_comes_and_goes_and_both_are_called(
    pair: tuple[socket.socket, socket.socket],
) -> None:
    ours, theirs = pair

    async def main() -> None:
        loop = asyncio.get_running_loop()
        written, read = asyncio.Event(), asyncio.Event()

        def take() -> None:
            ours.recv(100)
            read.set()

        loop.add_reader(ours, take)
        loop.add_writer(ours, written.set)
        theirs.send(b"1")
        await written.wait()
        await read.wait()
        assert loop.remove_writer(ours)
        read.clear()
        theirs.send(b"2")
        await read.wait()
        assert loop.remove_reader(ours)
        assert not loop.remove_reader(ours)

    run(main())


def test_a_descriptor_that_was_closed_without_a_word_and_is_used_again_belongs_to_its_new_user() -> None:
    async def main() -> None:
        loop = asyncio.get_running_loop()
        old, other = socket.socketpair()
        loop.add_reader(old, pytest.fail, "the old reader was called")
        number = old.fileno()
        old.close()
        other.close()
        ours, theirs = socket.socketpair()
        with theirs:
            assert number in {ours.fileno(), theirs.fileno()}
            first, second = (ours, theirs) if ours.fileno() == number else (theirs, ours)
            first.setblocking(False)
            second.send(b"new")
            assert await loop.sock_recv(first, 100) == b"new"
            ours.close()

    run(main())


def test_a_pause_is_made_before_the_next_look_and_no_timer_is_late_by_more(
    pair: tuple[socket.socket, socket.socket], monkeypatch: pytest.MonkeyPatch
) -> None:
    ours, theirs = pair
    pauses: list[float] = []
    monkeypatch.setattr("msbot_agent.process.direct_loop.time.sleep", pauses.append)

    async def main() -> None:
        loop = asyncio.get_running_loop()
        gathering = gathering_of(loop)
        assert gathering is not None
        done = loop.create_future()

        def read() -> bool:
            ours.recv(100)
            gathering.delay_s = 0.0 if pauses else 0.0001
            if pauses:
                done.set_result(None)
            else:
                theirs.send(b"second")
            return True

        loop.add_reader(ours, read)
        theirs.send(b"first")
        await done
        gathering.delay_s = 60.0
        await asyncio.sleep(0.005)
        gathering.delay_s = 0.0
        loop.remove_reader(ours)

    run(main())
    assert pauses[0] == 0.0001
    assert all(pause <= 0.005 for pause in pauses)


def test_a_masters_loop_may_pause_longer() -> None:
    async def main() -> float:
        gathering = gathering_of(asyncio.get_running_loop())
        assert gathering is not None
        for number in range(1, 200):  # 1,000 a second
            pause_s = gathering.turn(100.0 + number / 1_000, 1)
            if pause_s:
                return pause_s
        return 0.0

    assert 0.001 < run_to_end(main(), TimerGridLoop) <= LONGEST_PAUSE_S


def test_in_debug_mode_asyncio_calls_the_readers_itself(pair: tuple[socket.socket, socket.socket]) -> None:
    ours, theirs = pair

    async def main() -> bytes:
        loop = asyncio.get_running_loop()
        loop.set_debug(True)
        done: asyncio.Future[bytes] = loop.create_future()
        loop.add_reader(ours, lambda: done.set_result(ours.recv(100)))
        theirs.send(b"slowly")
        found = await done
        loop.remove_reader(ours)
        return found

    assert run(main()) == b"slowly"
