"""Parts on a CAN bus whose master is elsewhere: who they are, STOP both ways, cut and heal, a slow bus."""

import asyncio

import pytest

from msbot.part import HelloWorld
from msbot.part.join.joining import JoinState
from msbot.process.virtual_time import run_virtual
from msbot_agent.explain.relay_words import relay_words
from msbot_agent.link import BaseLink, LinkInfo, LossyLink, Peer, Signal
from msbot_agent.link.relay import PartsRelay
from msbot_xrce.errors import ConfigError, LinkDown
from msbot_xrce.message_words import explain
from tests.link.relay.stage import Stage, play


def test_parts_behind_a_relay_are_parts_of_the_robot_and_the_master_says_where_they_are() -> None:
    async def scene(stage: Stage) -> None:
        assert stage.states() == {"MOUTH": "active", "EAR": "active"}
        for index in range(20):
            assert stage.mouth.publish("say", HelloWorld(index=index, message="hi"))
            await asyncio.sleep(0.05)
        places = {view.address for view in stage.master.agent.clients()} - {
            "in-process client 1",
            "in-process client 2",
            "in-process client 3",
        }
        assert places == {"CAN node 1 behind relay pi", "CAN node 2 behind relay pi"}
        found = stage.master.inventory.find("MOUTH", asyncio.get_running_loop().time())
        assert [info.uid for info in found] == [b"a mouth."]

    stage = play(scene)
    assert stage.heard == list(range(20))


def test_a_call_goes_through_a_relay_and_its_packets_are_explained(monkeypatch: pytest.MonkeyPatch) -> None:
    packets: list[bytes] = []
    send = LossyLink.send

    def listen(link: LossyLink, packet: bytes, peer: Peer) -> None:
        packets.append(packet)
        send(link, packet, peer)

    monkeypatch.setattr(LossyLink, "send", listen)

    async def scene(stage: Stage) -> None:
        packets.clear()
        stage.ask(9.0)
        await asyncio.sleep(1)
        stage.ask(-1.0)
        await asyncio.sleep(1)
        assert stage.answers == [4.5, "call of ask: refused: nothing below zero"]
        told = [words for words in map(relay_words, packets) if words is not None and words.up and words.packet]
        inside = [line for words in told for line in explain(words.packet)]
        assert any("request" in line for line in inside), inside
        stage.cut()
        stage.ask(3.0, 2.0)
        await asyncio.sleep(3)
        assert len(stage.answers) == 3
        assert "no reply" in str(stage.answers[2])
        stage.heal()
        await asyncio.sleep(20)
        stage.ask(3.0)
        await asyncio.sleep(1)
        assert stage.answers[3:] == [1.5]

    play(scene, services=True)


def test_a_cut_loses_the_parts_for_its_reason_and_they_are_back_when_it_heals() -> None:
    async def scene(stage: Stage) -> None:
        stage.cut()
        await asyncio.sleep(3)
        assert set(stage.states().values()) == {"lost"}
        await asyncio.sleep(5)
        assert stage.ear.state is not JoinState.ACTIVE
        stage.heal()
        await asyncio.sleep(5)
        assert stage.states() == {"MOUTH": "active", "EAR": "active"}
        stage.mouth.publish("say", HelloWorld(index=7, message="again"))
        await asyncio.sleep(1)

    stage = play(scene)
    assert stage.heard == [7]
    lost = [event.reason for event in stage.events if event.to_state.value == "lost"]
    assert lost == ["gone: the relay pi is silent"] * 2
    assert any("is silent" in words for words in stage.said)
    assert any("is heard again after" in words for words in stage.said)


@pytest.mark.parametrize("seconds", [1.0, 2.9, 20.0, 40.0, 70.0])
def test_however_long_the_cut_is_the_parts_come_back(seconds: float) -> None:
    async def scene(stage: Stage) -> None:
        stage.cut()
        await asyncio.sleep(seconds)
        stage.heal()
        await asyncio.sleep(6)
        assert stage.states() == {"MOUTH": "active", "EAR": "active"}
        assert stage.mouth.state is stage.ear.state is JoinState.ACTIVE

    play(scene)


def test_stop_of_the_master_is_a_stop_frame_on_the_bus_before_anything_else() -> None:
    async def scene(stage: Stage) -> None:
        frames: list[int] = []
        stage.bus.on_frame(lambda at, sender, frame: frames.append(frame.can_id))
        for index in range(40):
            stage.mouth.publish("say", HelloWorld(index=index, message="a flood of words"))
        frames.clear()
        stage.master.say_stop("a test")
        await asyncio.sleep(0.01)
        ours = [can_id for can_id in frames if can_id == 0x008 or 0x180 < can_id <= 0x1F8]
        assert ours[:3] == [0x008] * 3
        await asyncio.sleep(1)
        assert not stage.master.stop.silent
        assert len(stage.master.stop.confirmed) == 2

    assert "the master says STOP" in play(scene).said


@pytest.mark.parametrize("lossy", [0.0, 0.3])
def test_stop_on_the_bus_reaches_the_master_and_holds_once(lossy: float) -> None:
    async def scene(stage: Stage) -> None:
        stage.cable.disturbance.drop = lossy
        stage.bus.send_stop(1)  # a node on the bus says it; its own controller hears it like any other
        stage.relay.forwarder.stop_heard("STOP was pressed", asyncio.get_running_loop().time())
        await asyncio.sleep(3)
        assert stage.master.stop.stopped
        assert stage.master.stop.number == 1
        stage.master.say_go("a test")
        await asyncio.sleep(5)
        assert not stage.master.stop.stopped

    play(scene)


def test_a_stop_that_the_relay_missed_is_said_on_its_bus_when_the_cable_heals() -> None:
    async def scene(stage: Stage) -> None:
        stage.cut()
        await asyncio.sleep(0.5)
        stage.master.say_stop("a test")
        await asyncio.sleep(0.5)
        assert "the master says STOP" not in stage.said
        stage.heal()
        await asyncio.sleep(1)
        assert "the master says STOP" in stage.said

    play(scene)


def test_a_lossy_cable_costs_time_but_no_reliable_message() -> None:
    async def scene(stage: Stage) -> None:
        assert set(stage.states().values()) <= {"active", "late"}, "a beat may have been lost"
        for index in range(50):
            stage.mouth.publish("say", HelloWorld(index=index, message="hi"))
            await asyncio.sleep(0.05)
        await asyncio.sleep(3)

    heard = play(scene, drop=0.1).heard
    assert heard == sorted(set(heard))
    assert len(heard) >= 45


def test_a_relay_that_ends_says_so_and_its_parts_are_lost_at_once() -> None:
    async def scene(stage: Stage) -> None:
        stage.end_relay()
        await asyncio.sleep(0.1)
        assert set(stage.states().values()) == {"lost"}

    stage = play(scene)
    assert "behind relay pi has ended" in stage.events[-1].reason


def test_what_the_relays_own_link_says_of_a_part_reaches_the_master_at_once() -> None:
    async def scene(stage: Stage) -> None:
        for peer in list(stage.relay.forwarder._by_peer):
            stage.relay._parts_signalled(Signal.PEER_GONE, peer, "pulled out", asyncio.get_running_loop().time())
        await asyncio.sleep(0.05)
        assert stage.states() == {"MOUTH": "lost", "EAR": "lost"}
        assert "pulled out" in stage.events[-1].reason

    assert sum(words.startswith("the master on ") and "takes the parts of" in words for words in play(scene).said) == 1


class NarrowLink(BaseLink):
    """A link whose packets are too small for a relay."""

    def __init__(self) -> None:
        super().__init__(LinkInfo("narrow:", 63), remote=0)


def test_a_way_with_tiny_packets_is_refused_with_a_sentence() -> None:
    async def main() -> None:
        with pytest.raises(ConfigError, match="63 bytes, and a relay needs 256"):
            PartsRelay(lambda _: NarrowLink(), NarrowLink(), name="pi", say=print)  # type: ignore[arg-type, return-value]

    asyncio.run(main())


def test_a_packet_that_is_too_long_for_the_way_does_not_hold_up_the_next(monkeypatch: pytest.MonkeyPatch) -> None:
    class Way(BaseLink):
        """A link that takes everything."""

        def __init__(self) -> None:
            super().__init__(LinkInfo("way:", 300), remote=0)
            self.sent: list[bytes] = []

        def has_room(self, _peer: Peer) -> bool:
            return True

        def send(self, packet: bytes, _peer: Peer) -> None:
            self.sent.append(packet)

    async def main() -> None:
        way = Way()
        relay = PartsRelay(lambda _: NarrowLink(), way, name="pi", say=print)  # type: ignore[arg-type, return-value]
        queue = [bytes(300), bytes(301), b"next"]
        monkeypatch.setattr(relay.forwarder, "to_master", lambda: queue.pop(0) if queue else None)
        relay._pump()
        assert [len(packet) for packet in way.sent] == [300, 4]
        assert sum(relay.forwarder.dropped.values()) == 1

    asyncio.run(main())


def test_a_way_that_cannot_be_opened_is_said_once_for_each_reason_and_tried_again() -> None:
    class ClosedLink(BaseLink):
        """A link whose network is not there yet."""

        def __init__(self) -> None:
            super().__init__(LinkInfo("closed:", 1000), remote=0)
            self.reasons = ["nobody answers", "no such network", "no such network", "no such network"]

        def has_room(self, _peer: Peer) -> bool:
            return False

        def send(self, _packet: bytes, _peer: Peer) -> None:
            raise LinkDown("it is not open")

        async def run(self) -> None:
            raise LinkDown(self.reasons.pop() if len(self.reasons) > 1 else self.reasons[0])

    said: list[str] = []

    async def main() -> None:
        relay = PartsRelay(lambda _: NarrowLink(), ClosedLink(), name="pi", say=said.append)  # type: ignore[arg-type, return-value]
        running = asyncio.get_running_loop().create_task(relay.run())
        await asyncio.sleep(60.0)
        running.cancel()
        with pytest.raises(asyncio.CancelledError):
            await running

    run_virtual(main())
    assert [words for words in said if words.startswith("no way")] == [
        "no way to the master yet: no such network",
        "no way to the master yet: nobody answers",
    ]
