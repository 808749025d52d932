"""A robot with `authentication = "key+data"`: recorded and spoofed packets move nothing (issue 11, point 17)."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable
from random import Random

import pytest

from msbot.part import HelloWorld, Part
from msbot.part.join import pnp_messages
from msbot.part.join.joining import JoinState
from msbot.part.join.seal import SEAL_OCTETS, Seal
from msbot.pnp import Keys, PartState, Refusal
from msbot.process.virtual_time import run_virtual
from msbot_agent.link import InprocEnd, LossyLink, Peer
from msbot_xrce.messages import (
    SESSION_NONE,
    CreateClient,
    Data,
    Header,
    WriteData,
    encode_message,
    iter_submessages,
)
from tests.pnp.robot import sample_store, uid
from tests.pnp.scene import Robot, epoch_ns

KEY = bytes(range(16))
SPOOFED = 0x02
"""A stream that the real ends do not use: what is put there disturbs no number of theirs."""


class Spy(LossyLink):
    """A part's link with somebody on it who records all and can speak for either end."""

    def __init__(self, link: InprocEnd) -> None:
        super().__init__(link, random=Random(1))
        self.up: list[bytes] = []
        self.down: list[bytes] = []
        self.both: list[tuple[bool, bytes]] = []
        """All packets in the order in which they came, and whether they went up."""
        self._numbers = {True: 0, False: 0}

    def send(self, packet: bytes, peer: Peer) -> None:
        self.up.append(packet)
        self.both.append((True, packet))
        super().send(packet, peer)

    def _received(self, packet: bytes, peer: Peer, now: float) -> None:
        self.down.append(packet)
        self.both.append((False, packet))
        super()._received(packet, peer, now)

    def recorded(self, *, up: bool) -> list[tuple[int, bytes]]:
        """Object ids and payloads of all samples so far."""
        wanted = WriteData if up else Data
        found = [submessage for packet in (self.up if up else self.down) for submessage in iter_submessages(packet, 4)]
        return [(one.object_id, one.payload) for one in found if isinstance(one, wanted) and one.payload is not None]

    def spoof(self, object_id: int, payload: bytes, *, up: bool) -> None:
        """A sample in the name of the part, or of the master."""
        kind = WriteData if up else Data
        packet = encode_message(
            Header(0x81, SPOOFED, self._numbers[up], None), [kind(10, object_id, payload)], pad_end=False
        )
        self._numbers[up] += 1
        if up:
            assert self.remote is not None
            self.inner.send(packet, self.remote)
        else:
            assert self._packet_handler is not None
            self._packet_handler(packet, self.remote, asyncio.get_running_loop().time())


class Story:
    """AA says a number four times a second, BB hears it; somebody sits on both wires."""

    def __init__(self, *, sealed: bool, keys: tuple[bytes, bytes] = (KEY, KEY)) -> None:
        store = sample_store()
        store.keys = {uid(1): KEY, uid(2): KEY}
        self.robot = Robot(store, explain=True, keys=Keys(store, Random(3), sealed=sealed))
        self.aa = Part("ABCD", local_name="AA", uid=uid(1), random=Random(7), key=keys[0])
        self.bb = Part("EFGH", local_name="BB", uid=uid(2), random=Random(8), key=keys[1])
        self.wires = [Spy(self.robot.outside.connect()) for _ in range(2)]
        self.aa.every(0.25)(self._speak)
        self.bb.on("in", HelloWorld)(lambda message: self.heard.append(message.index))
        self.heard: list[int] = []
        self.changes: list[tuple[str, PartState]] = []
        self.robot.inventory.on_event(lambda event: self.changes.append((event.part, event.to_state)))
        self._count = 0

    def _speak(self) -> None:
        self._count += 1
        self.aa.publish("out", HelloWorld(index=self._count, message="AA"))

    @property
    def now(self) -> float:
        return asyncio.get_running_loop().time()

    def why(self, part: str) -> str:
        return "\n".join(self.robot.inventory.why(part, self.now))


def tell(
    story: Callable[[Story], Awaitable[None]], *, sealed: bool = True, keys: tuple[bytes, bytes] = (KEY, KEY)
) -> None:
    async def main() -> None:
        scene = Story(sealed=sealed, keys=keys)
        async with asyncio.TaskGroup() as tasks:
            running = [tasks.create_task(run()) for run in (scene.robot.agent.run, scene.robot.service.run)]
            running.append(tasks.create_task(scene.robot.master.run()))
            await scene.robot.service.until_ready()
            for part, wire in zip((scene.aa, scene.bb), scene.wires, strict=True):
                running.append(tasks.create_task(part.run_async(wire, epoch_ns=epoch_ns)))
            await asyncio.sleep(3.0)
            await story(scene)
            for task in running:
                task.cancel()

    run_virtual(main())


def test_parts_talk_beat_and_obey_as_ever() -> None:
    async def story(scene: Story) -> None:
        await asyncio.sleep(20.0)
        assert scene.heard == list(range(scene.heard[0], scene.heard[0] + len(scene.heard)))
        assert len(scene.heard) > 80
        scene.robot.service.stop_all("ann", "", 0)
        await asyncio.sleep(1.5)
        assert scene.aa.stopped
        assert scene.bb.stopped
        assert len(scene.robot.service.stop.status().confirmed) == 2
        scene.robot.service.go_all("ann")
        await asyncio.sleep(0.5)
        assert not scene.aa.stopped
        assert {state for _, state in scene.changes} <= {PartState.NEW, PartState.CHECKING, PartState.ACTIVE}
        assert scene.aa.counters.refused == scene.bb.counters.refused == 0
        assert scene.robot.inventory.dropped.get("sample without a good seal", 0) == 0

    tell(story)


@pytest.mark.parametrize("sealed", [False, True])
def test_a_recorded_sample_played_back_in_a_parts_name(sealed: bool) -> None:
    async def story(scene: Story) -> None:
        wire = scene.wires[0]
        writers = [(object_id, payload) for object_id, payload in wire.recorded(up=True) if object_id & 0xF == 5]
        for object_id, payload in writers[-3:]:
            wire.spoof(object_id, payload, up=True)
        await asyncio.sleep(0.1)
        assert len(scene.heard) - len(set(scene.heard)) == (0 if sealed else 3)
        if sealed:
            assert "Samples in its name without a good seal, refused: 3." in scene.why("AA")
            assert sum("was refused: repeated" in line for line in scene.why("AA").splitlines()) == 1

    tell(story, sealed=sealed)


@pytest.mark.parametrize("sealed", [False, True])
def test_a_recorded_sample_played_back_to_a_part(sealed: bool) -> None:
    async def story(scene: Story) -> None:
        wire = scene.wires[1]
        samples = [(object_id, payload) for object_id, payload in wire.recorded(up=False) if object_id & 0xF == 6]
        ports = [sample for sample in samples if sample[0] != samples[0][0]]  # the first is the profile's reader
        before = len(scene.heard)
        for object_id, payload in ports[-3:]:
            wire.spoof(object_id, payload, up=False)
        assert len(scene.heard) - before == (0 if sealed else 3)
        assert scene.bb.counters.refused == (3 if sealed else 0)

    tell(story, sealed=sealed)


@pytest.mark.parametrize("sealed", [False, True])
def test_a_go_that_was_recorded_ends_no_later_stop(sealed: bool) -> None:
    async def story(scene: Story) -> None:
        wire = scene.wires[1]
        requester = 0x0017
        scene.robot.service.stop_all("ann", "", 0)
        await asyncio.sleep(1.5)
        assert scene.bb.stopped
        notice = pnp_messages.Notice(
            number=9, binding=pnp_messages.NO_BINDING, kind=pnp_messages.NoticeKind.GO
        ).encode()
        wire.spoof(requester, bytes(4) + notice, up=False)
        for object_id, payload in wire.recorded(up=False):
            if object_id == requester:
                wire.spoof(object_id, payload, up=False)
        assert scene.bb.stopped is sealed

    tell(story, sealed=sealed)


def test_beats_in_the_name_of_a_silent_part_do_not_keep_it_alive() -> None:
    async def story(scene: Story) -> None:
        wire = scene.wires[0]
        beats = [payload for object_id, payload in wire.recorded(up=True) if object_id == 0x0017 and len(payload) == 14]
        assert beats
        wire.disturbance.drop = 1.0
        for _ in range(16):
            wire.spoof(0x0017, beats[-1], up=True)
            wire.spoof(0x0017, beats[-1][:4], up=True)
            await asyncio.sleep(0.5)
        assert ("AA", PartState.LOST) in scene.changes

    tell(story)


def test_a_beat_from_before_a_new_session_is_not_held_against_the_part() -> None:
    async def story(scene: Story) -> None:
        wire = scene.wires[0]
        beats = [payload for object_id, payload in wire.recorded(up=True) if object_id == 0x0017 and len(payload) == 14]
        (aa,) = (one for one in scene.robot.inventory.view(scene.now) if one.slot == "AA")
        login = encode_message(Header(SESSION_NONE), [CreateClient(aa.client_key, 0x82, 512)], pad_end=False)
        assert wire.remote is not None
        wire.spoof(0x0017, beats[-1], up=True)
        wire.inner.send(login, wire.remote)  # both in one turn of the loop, as when the master was held up
        await asyncio.sleep(0.1)
        assert ("AA", PartState.CHECKING) in scene.changes[-3:]
        assert scene.robot.service.requests.dropped["request without a good seal"] > 0
        assert "was refused" not in scene.why("AA")

    tell(story)


def test_until_a_part_uses_its_new_seal_the_old_one_is_not_held_against_it() -> None:
    async def story(scene: Story) -> None:
        (aa,) = (one for one in scene.robot.inventory.view(scene.now) if one.slot == "AA")
        scene.robot.inventory.seals.put(aa.client_key, bytes(32))  # as when it has proved its key a second time
        heard = len(scene.heard)
        await asyncio.sleep(1.2)
        assert len(scene.heard) == heard, "nothing with the old seal passes"
        assert scene.robot.service.requests.dropped["request without a good seal"] > 0, "beats are counted as well"
        assert "sample without a good seal" not in scene.robot.inventory.dropped
        assert "was refused" not in scene.why("AA")
        wire = scene.wires[0]
        port, sample = [one for one in wire.recorded(up=True) if one[0] & 0xF == 5][-1]
        wire.spoof(port, Seal(bytes(32), is_part=True).seal(port, sample[:-SEAL_OCTETS]), up=True)
        await asyncio.sleep(0.01)
        assert len(scene.heard) == heard + 1
        await asyncio.sleep(0.3)
        assert scene.robot.inventory.dropped["sample without a good seal"] > 0, "from now on, the old one is wrong"
        assert "Samples in its name without a good seal, refused: " in scene.why("AA")

    tell(story)


def test_a_changed_bit_anywhere_in_what_is_played_back_changes_nothing() -> None:
    async def story(scene: Story) -> None:
        random = Random(5)
        wire = scene.wires[0]
        changes, heard = list(scene.changes), len(scene.heard)
        recorded = wire.recorded(up=True)
        for number in range(400):
            if number % 50 == 0:
                await asyncio.sleep(0.001)
            object_id, payload = random.choice(recorded)
            spoiled = bytearray(payload)
            spoiled[random.randrange(len(spoiled))] ^= 1 << random.randrange(8)
            wire.spoof(object_id, bytes(spoiled), up=True)
        await asyncio.sleep(0.01)
        assert len(scene.heard) == len(set(scene.heard))
        assert len(scene.heard) - heard <= 1  # the part's own
        assert [change for change in scene.changes[len(changes) :] if change[1] is not PartState.ACTIVE] == []
        assert scene.robot.inventory.dropped["sample without a good seal"] > 100
        await asyncio.sleep(5.0)
        assert scene.aa.state is JoinState.ACTIVE

    tell(story)


def test_a_part_that_answers_like_one_that_cannot_seal_is_refused() -> None:
    async def story(scene: Story) -> None:
        wire = scene.wires[0]
        before = scene.changes[:]
        wire.spoof(0x0017, bytes(16), up=True)
        await asyncio.sleep(0.1)
        assert scene.changes[len(before) :] == [("AA", PartState.ACTIVE)]  # a note
        assert scene.aa.state is JoinState.ACTIVE

    tell(story)


def test_another_key_is_refused_with_its_reason() -> None:
    async def story(scene: Story) -> None:
        assert scene.bb.state is JoinState.REFUSED
        assert scene.bb.reason == Refusal.WRONG_KEY.describe
        assert scene.aa.state is JoinState.ACTIVE

    tell(story, keys=(KEY, bytes(16)))


def test_a_part_that_comes_back_has_other_seals() -> None:
    async def story(scene: Story) -> None:
        wire = scene.wires[1]
        old = [(object_id, payload) for object_id, payload in wire.recorded(up=False) if object_id & 0xF == 6][-1]
        wire.disturbance.drop = 1.0
        await asyncio.sleep(10.0)
        wire.disturbance.drop = 0.0
        await asyncio.sleep(12.0)
        assert scene.bb.state is JoinState.ACTIVE
        heard = len(scene.heard)
        wire.spoof(*old, up=False)
        assert len(scene.heard) == heard
        await asyncio.sleep(2.0)
        assert len(scene.heard) > heard

    tell(story)
