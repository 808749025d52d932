"""A part with several masters of which one serves: it hears one at a time, and finds the one that answers."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable

import pytest

from msbot.process.virtual_time import run_virtual
from msbot_agent.link import BaseLink, LinkInfo, Peer, Signal, open_link
from msbot_agent.link.failover_link import ANOTHER, LOOK_S, MASTER, PATIENCE_S, TRY_S, FailoverLink
from msbot_agent.link.net.udp import NOBODY_LISTENS
from msbot_xrce.errors import ConfigError, LinkDown


class Way(BaseLink):
    """A link to one master, which answers everything, or nothing, or does not listen."""

    def __init__(self, name: str, *, shared_bus: bool = False) -> None:
        super().__init__(LinkInfo(name, 1000, shared_bus=shared_bus), remote=name)
        self.answers = True
        self.listens = True
        self.opens = self.has_space = True
        self.got: list[bytes] = []

    def has_room(self, peer: Peer) -> bool:
        return peer == self.remote and self.has_space

    def send(self, packet: bytes, peer: Peer) -> None:
        assert peer == self.remote
        self.got.append(packet)
        if not self.listens:
            self.counters.dropped.count(NOBODY_LISTENS)
        elif self.answers:
            asyncio.get_running_loop().call_soon(self.say, b"yes to " + packet)

    def say(self, packet: bytes) -> None:
        self._received(packet, self.remote, asyncio.get_running_loop().time())

    def describe(self, peer: Peer) -> str:
        return str(peer)

    async def run(self) -> None:
        if not self.opens:
            raise LinkDown(f"{self.info.name}: no way to that network")
        self._signal_handler(Signal.LINK_UP, None, "opened", 0.0)
        await asyncio.get_running_loop().create_future()


class Stage:
    def __init__(self) -> None:
        self.one, self.two = Way("one"), Way("two")
        self.link = FailoverLink([self.one, self.two])
        self.heard: list[bytes] = []
        self.signals: list[tuple[Signal, str]] = []
        self.link.attach(
            packet=lambda packet, _peer, _now: self.heard.append(packet),
            signal=lambda signal, _peer, words, _now: self.signals.append((signal, words)),
        )

    async def ask(self, words: bytes, seconds: float = 0.05) -> None:
        self.link.send(words, MASTER)
        await asyncio.sleep(seconds)


def play(scene: Callable[[Stage], Awaitable[None]]) -> None:
    async def main() -> None:
        stage = Stage()
        running = asyncio.get_running_loop().create_task(stage.link.run())
        await asyncio.sleep(0.01)
        await scene(stage)
        running.cancel()
        await asyncio.gather(running, return_exceptions=True)

    run_virtual(main())


def test_a_master_that_answers_is_kept_and_the_other_is_not_heard() -> None:
    async def scene(stage: Stage) -> None:
        assert stage.signals == [(Signal.LINK_UP, "one")]
        for number in range(10):
            await stage.ask(b"%d" % number, 1.0)
        stage.two.say(b"move!")
        assert stage.link.counters.dropped == {ANOTHER: 1}
        assert stage.heard == [b"yes to %d" % number for number in range(10)]
        assert stage.two.got == []

    play(scene)


def test_a_master_that_falls_silent_is_left_and_speaks_to_the_wind_when_it_thaws() -> None:
    async def scene(stage: Stage) -> None:
        await stage.ask(b"a")
        stage.one.answers = False
        await stage.ask(b"b", PATIENCE_S + 2 * LOOK_S)
        assert stage.signals[1:] == [
            (Signal.LINK_DOWN, "no answer from one for 2.2 s"),
            (Signal.LINK_UP, "two"),
        ]
        await stage.ask(b"c")
        stage.one.say(b"move!")
        assert stage.heard == [b"yes to a", b"yes to c"]
        assert stage.link.describe(MASTER) == "the master at two"

    play(scene)


def test_silence_without_a_question_is_no_silence() -> None:
    async def scene(stage: Stage) -> None:
        await stage.ask(b"a", 100.0)
        assert stage.link.in_use is stage.one

    play(scene)


def test_where_nobody_listens_is_left_at_once() -> None:
    async def scene(stage: Stage) -> None:
        await stage.ask(b"a")
        stage.one.listens = False
        await stage.ask(b"b", 2 * LOOK_S)
        assert stage.link.in_use is stage.two
        assert stage.signals[1] == (Signal.LINK_DOWN, "nobody listens at one")

    play(scene)


def test_a_way_that_opens_later_changes_nothing_until_it_is_needed() -> None:
    async def main() -> None:
        stage = Stage()
        stage.one.opens = False
        running = asyncio.get_running_loop().create_task(stage.link.run())
        await asyncio.sleep(0.5)
        assert stage.signals == [(Signal.LINK_UP, "two")], "the one that opens first"
        await stage.ask(b"a")
        stage.one.opens = True
        await asyncio.sleep(1.0)
        assert stage.signals == [(Signal.LINK_UP, "two")]
        assert stage.link.in_use is stage.two
        stage.two.answers = False
        await stage.ask(b"b", PATIENCE_S + 2 * LOOK_S)
        assert stage.signals[1:] == [
            (Signal.LINK_DOWN, "no answer from two for 2.2 s"),
            (Signal.LINK_UP, "one"),
        ]
        running.cancel()
        await asyncio.gather(running, return_exceptions=True)

    run_virtual(main())


def test_all_are_tried_in_turn_until_one_answers() -> None:
    async def scene(stage: Stage) -> None:
        stage.one.answers = stage.two.answers = False
        for _ in range(6):
            await stage.ask(b"?", TRY_S + 2 * LOOK_S)
        assert len(stage.one.got) == len(stage.two.got) == 3
        stage.two.answers = True
        for _ in range(4):
            await stage.ask(b"!", TRY_S + 2 * LOOK_S)
        assert stage.link.in_use is stage.two
        assert stage.heard

    play(scene)


def test_what_breaks_at_a_master_that_is_not_in_use_is_not_told() -> None:
    async def scene(stage: Stage) -> None:
        await stage.ask(b"?")
        stage.two._signal_handler(Signal.LINK_DOWN, None, "closed", 0.1)
        assert stage.signals == [(Signal.LINK_UP, "one")]
        assert stage.link.in_use is stage.one
        stage.one._signal_handler(Signal.LINK_DOWN, None, "closed", 0.2)
        assert stage.signals[1:] == [(Signal.LINK_DOWN, "closed")]

    play(scene)


def test_one_that_cannot_be_opened_is_no_reason_to_give_up_unless_none_can() -> None:
    async def main(one: bool, two: bool) -> list[bytes]:
        stage = Stage()
        stage.one.opens, stage.two.opens = one, two
        running = asyncio.get_running_loop().create_task(stage.link.run())
        await asyncio.sleep(0.3)
        if not running.done():
            await stage.ask(b"hello")
            running.cancel()
        await asyncio.gather(running, return_exceptions=not running.done() or running.cancelled())
        return stage.heard

    assert run_virtual(main(one=False, two=True)) == [b"yes to hello"]
    with pytest.raises(LinkDown, match="no way to that network"):
        run_virtual(main(one=False, two=False))


def test_addresses_with_commas_are_several_masters_for_a_part_and_none_for_a_master() -> None:
    link = open_link("udp:127.0.0.1:8888,tcp:127.0.0.1:8889")
    assert isinstance(link, FailoverLink)
    assert link.info.name == "udp:127.0.0.1:8888,tcp:127.0.0.1:8889"
    with pytest.raises(ConfigError, match="a master serves each of them: give --link several times"):
        open_link("udp:127.0.0.1:8888,udp:127.0.0.1:8889", serve=True)
    with pytest.raises(ConfigError, match="a bus has one master at a time"):
        FailoverLink([Way("one"), Way("bus", shared_bus=True)])


def test_there_is_room_where_the_link_in_use_has_some_and_only_for_the_master() -> None:
    async def scene(stage: Stage) -> None:
        assert (stage.link.has_room(MASTER), stage.link.has_room("one")) == (True, False)
        stage.one.has_space = False
        assert not stage.link.has_room(MASTER)
        stage.one.remote, stage.one.has_space = None, True
        assert not stage.link.has_room(MASTER)

    play(scene)
