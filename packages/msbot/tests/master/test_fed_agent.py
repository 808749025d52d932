"""Several agents feed one master: who is in, samples here and there, cut and heal, STOP both ways."""

import asyncio

import pytest

from msbot.part.join.joining import JoinState
from msbot.pnp import Freeze
from tests.master.fed_stage import Stage, play

ALL = {"MOUTH": "active", "NEAR": "active", "FAR": "active"}


def test_parts_at_two_agents_are_parts_of_one_robot_and_hear_each_other() -> None:
    async def scene(stage: Stage) -> None:
        assert stage.states() == ALL
        for number in range(20):
            stage.speak(number)
            await asyncio.sleep(0.05)
        await asyncio.sleep(0.5)
        now = asyncio.get_running_loop().time()
        addresses = {info.part_number: info.address for info in stage.master.inventory.view(now)}
        assert addresses["FAR"].endswith("by agent right")
        assert addresses["MOUTH"].endswith("by agent left")
        assert len(addresses) == 3  # the agents themselves are no parts

    stage = play(scene)
    assert stage.heard == {"MOUTH": [], "NEAR": list(range(20)), "FAR": list(range(20))}


def test_a_short_cut_costs_the_parts_of_one_agent_nothing() -> None:
    async def scene(stage: Stage) -> None:
        stage.left.cut()
        for number in range(20):
            stage.speak(number)
            await asyncio.sleep(0.05)
        stage.left.heal()
        await asyncio.sleep(3)
        assert stage.states() == ALL
        assert stage.parts["MOUTH"].state is JoinState.ACTIVE

    stage = play(scene)
    assert stage.heard["NEAR"] == list(range(20))
    assert not any("lost" in event.to_state.value for event in stage.events)


def test_a_long_cut_keeps_the_verdicts_lets_nobody_in_and_is_told_on_both_sides() -> None:
    async def scene(stage: Stage) -> None:
        stage.left.cut()
        await asyncio.sleep(2.6)
        stage.speak(1)  # its own beats have not given the master up yet
        await asyncio.sleep(0.2)
        assert stage.heard["NEAR"] == [1]
        assert stage.states() == ALL | {"MOUTH": "lost", "NEAR": "lost"}
        told = stage.master.why("MOUTH")
        assert any("gone: the agent left is silent" in line for line in told), told
        stage.parts.pop("FAR")
        stage.start("FAR", stage.left)
        await asyncio.sleep(20)
        assert stage.parts["FAR"].state is JoinState.LOST or stage.parts["FAR"].state is JoinState.LOOKING
        assert stage.parts["MOUTH"].state is not JoinState.ACTIVE
        stage.left.heal()
        await asyncio.sleep(8)
        assert stage.states()["MOUTH"] == stage.states()["NEAR"] == "active"
        stage.speak(2)
        await asyncio.sleep(0.5)

    stage = play(scene)
    assert stage.heard["NEAR"] == [1, 2]
    assert any("the master is silent: 2 parts that are in stay as they are" in words for words in stage.left.said)
    assert any("the master is heard again after" in words for words in stage.left.said)
    assert not any("silent" in words for words in stage.right.said)


@pytest.mark.parametrize("seconds", [2.2, 3.5, 65.0])
def test_however_long_the_cut_is_the_parts_come_back(seconds: float) -> None:
    async def scene(stage: Stage) -> None:
        stage.left.cut()
        await asyncio.sleep(seconds)
        stage.left.heal()
        await asyncio.sleep(10)
        assert stage.states() == ALL
        stage.speak(7)
        await asyncio.sleep(0.5)

    assert play(scene).heard == {"MOUTH": [], "NEAR": [7], "FAR": [7]}


@pytest.mark.parametrize("drop", [0.0, 0.2])
def test_stop_of_the_master_reaches_the_parts_of_every_agent_and_go_ends_it(drop: float) -> None:
    async def scene(stage: Stage) -> None:
        frames: list[int] = []
        stage.right.agent.links[0].on_frame(  # type: ignore[attr-defined]
            lambda at, sender, frame: frames.append(frame.can_id)
        )
        stage.master.say_stop("a test")
        await asyncio.sleep(0.05 if not drop else 5)
        assert all(part.stopped for part in stage.parts.values())
        assert 0x008 in frames
        await asyncio.sleep(3)
        assert {one.part for one in stage.master.stop.confirmed} == {"MOUTH", "NEAR", "FAR"}
        stage.master.say_go("a test")
        await asyncio.sleep(0.1 if not drop else 8)
        assert not any(part.stopped for part in stage.parts.values())

    stage = play(scene, drop=drop, settle_s=15 if drop else 4, can=True)
    assert "the master says STOP" in stage.right.said


@pytest.mark.parametrize("drop", [0.0, 0.3])
def test_stop_on_the_bus_of_an_agent_is_stop_of_the_robot_once(drop: float) -> None:
    async def scene(stage: Stage) -> None:
        stage.left.agent.links[0].send_stop(1)  # type: ignore[attr-defined] # a bus can
        stage.left.agent.gate.stop_said("STOP was pressed")
        await asyncio.sleep(5 if drop else 0.1)
        assert stage.master.stop.number == 1
        assert stage.master.stop.stopped
        assert "at agent left" in stage.master.stop.reason
        assert stage.parts["FAR"].stopped
        stage.master.say_go("a test")
        await asyncio.sleep(8 if drop else 3)
        assert not stage.master.stop.stopped

    play(scene, drop=drop, settle_s=20 if drop else 4, can=True)


def test_a_stop_that_an_agent_missed_is_told_when_its_cable_heals() -> None:
    async def scene(stage: Stage) -> None:
        stage.left.cut()
        await asyncio.sleep(0.5)
        stage.master.say_stop("a test")
        await asyncio.sleep(0.5)
        assert not stage.parts["NEAR"].stopped
        stage.left.heal()
        await asyncio.sleep(1.5)
        assert stage.parts["NEAR"].stopped

    play(scene)


def test_an_agent_that_ends_says_so_and_its_parts_are_lost_at_once() -> None:
    async def scene(stage: Stage) -> None:
        stage.right.end()
        await asyncio.sleep(0.2)
        assert stage.states() == ALL | {"FAR": "lost"}

    assert "the agent right has ended" in play(scene).events[-1].reason


def test_a_robot_with_sealed_samples_takes_no_agent_and_says_what_would_be_right() -> None:
    async def scene(stage: Stage) -> None:
        assert stage.states() == {}

    stage = play(scene, authentication="key+data")
    assert len(stage.left.said) == 1
    assert "carry its parts here with `msbot relay`" in stage.left.said[0]


def test_a_pupils_part_at_an_agent_that_is_held_learns_so_at_once() -> None:
    """It calls, it is called by a part at its agent, and by one at another agent."""

    async def scene(stage: Stage) -> None:
        loop = asyncio.get_running_loop()
        inventory = stage.master.inventory

        def freeze(number: str, order: Freeze | None) -> None:
            key = inventory._index.holders[number.lower()].client_key
            inventory._index.sessions[key].pupil = "ben" if order else ""
            inventory.pupil_parts.pupils.freeze = order
            inventory.pupil_parts.follow(loop.time())

        why = "the class is frozen by ann: look at me"
        for number in ("MOUTH", "NEAR"):
            freeze(number, Freeze("ann", "look at me", loop.time()))
            await asyncio.sleep(1.0)
            before = loop.time()
            if number == "MOUTH":
                for port in ("ask", "ask_far"):
                    words = f"call of {port}: the robot does not pass it on: {why}"
                    assert await stage.ask("MOUTH", port, 1.0, 600.0) == words
            else:
                words = f"call of ask: the robot does not pass it on: slot near is held: {why}"
                assert await stage.ask("MOUTH", "ask", 1.0, 600.0) == words
                assert await stage.ask("FAR", "ask", 1.0, 600.0) == words
            assert loop.time() - before < 1.0
            freeze(number, None)
            await asyncio.sleep(1.0)
            assert await stage.ask("MOUTH", "ask", 4.0) == 8.0

    play(scene)


def test_a_part_that_moves_to_another_agent_gets_its_slot_back() -> None:
    async def scene(stage: Stage) -> None:
        stage.right.end()  # with its bus
        await asyncio.sleep(1)
        stage.start("FAR", stage.left)
        await asyncio.sleep(4)
        assert stage.states() == ALL
        stage.speak(3)
        await asyncio.sleep(0.5)

    assert play(scene).heard["FAR"] == [3]


@pytest.mark.promise("Parts at other agents serve and call as those at the master do")
@pytest.mark.parametrize("drop", [0.0, 0.1])
def test_parts_at_agents_serve_each_other_each_request_once(drop: float) -> None:
    async def scene(stage: Stage) -> None:
        assert await stage.ask("MOUTH", "ask", 21.0, 20.0) == 42.0  # at the same agent
        assert await stage.ask("MOUTH", "ask_far", 5.0, 20.0) == 15.0  # at the other one
        assert await stage.ask("FAR", "ask", 4.0, 20.0) == 8.0  # the other way
        assert stage.served == [21.0, 5.0, 4.0]

    play(scene, drop=drop, settle_s=20.0 if drop else 4.0)


def test_a_call_from_an_agent_for_a_part_that_is_not_there_ends_at_once_with_the_reason() -> None:
    async def scene(stage: Stage) -> None:
        stage.parts["FAR"].end()
        await asyncio.sleep(1.0)
        before = asyncio.get_running_loop().time()
        words = "call of ask_far: the robot does not pass it on: slot far is empty"
        assert await stage.ask("MOUTH", "ask_far", 1.0, 600.0) == words
        assert asyncio.get_running_loop().time() - before < 1.0
        stage.left.cut()
        asking = asyncio.create_task(stage.ask("MOUTH", "ask_far", 1.0, 600.0))
        assert await stage.ask("MOUTH", "ask", 3.0) == 6.0  # the part that serves is at the same agent
        await asyncio.sleep(100.0)
        assert str(await asking).startswith("call of ask_far: the ")

    play(scene)


def test_a_part_that_moves_to_another_agent_serves_there() -> None:
    async def scene(stage: Stage) -> None:
        stage.parts["FAR"].end()
        await asyncio.sleep(1.0)
        stage.start("FAR", stage.left)
        await asyncio.sleep(8.0)
        assert await stage.ask("MOUTH", "ask_far", 2.0) == 6.0
        assert stage.served == [2.0]

    play(scene)
