"""STOP while people work with the robot: a rover of ten parts, and all that its page and commands can do. In virtual
time."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable, Mapping
from pathlib import Path
from typing import Any
from unittest import mock

from msbot.operations.dispatch import perform
from msbot.part import Part
from msbot.recording.replay.recorded_operations import OperationPlayer, RecordedOperation, RecordedOperations
from msbot_xrce.errors import MsbotError
from tests.lab.fault_stage import FaultStage, fault_scene
from tests.lab.test_missions import OWN, Played
from tests.stop.oracle import Oracle, Verdict, until_all_confirm

SOME_S = 1.0

Deed = Callable[[FaultStage, Path], Awaitable[None]]


async def _no_deed(_stage: FaultStage, _folder: Path) -> None:
    return


async def _apply(stage: FaultStage, folder: Path) -> None:
    path = folder / "robot.toml"
    text = path.read_text()
    assert "explain = true " in text
    path.write_text(text.replace("explain = true ", "explain = false "))
    await stage.operations.do("apply", who="Ada", path=str(path))


async def _roll_out_and_undo(stage: FaultStage, folder: Path) -> None:
    """The two requests that a roll-out and its undo send to a master."""

    async def ask(what: str, **args: object) -> Mapping[str, object]:
        answer = await perform(stage.operations, {"do": what, "args": args, "who": "Ada"})
        assert "error" not in answer, answer
        return answer

    path = folder / "rollout.toml"
    path.write_text((folder / "robot.toml").read_text().replace("explain = true ", "explain = false "))
    done = await ask("apply", path=str(path), folders=[])
    assert isinstance(done["edit"], int)
    await asyncio.sleep(SOME_S)
    await ask("undo", edit=done["edit"])


async def _reset(stage: FaultStage, folder: Path) -> None:
    """A parameter set by hand goes back to what the blueprint says."""
    await _set(stage, folder)
    await asyncio.sleep(SOME_S)
    await stage.operations.do("reset", who="Ada", slot="fan", name="start_at")


async def _set(stage: FaultStage, _folder: Path) -> None:
    await stage.operations.do("set", who="Ada", slot="fan", name="start_at", value="10")


async def _rewire(stage: FaultStage, _folder: Path) -> None:
    await stage.operations.do("add_slot", who="Ada", slot="fan2", part="FAN-5V")
    await stage.operations.do("remove_slot", who="Ada", slot="fan2")


async def _by_hand(stage: FaultStage, _folder: Path) -> None:
    """Somebody drives the fan from the page."""
    try:
        await stage.operations.do("publish", who="Ben", port="fan.power", values=["percent=70"], seconds=20)
    except MsbotError:
        return  # while STOP holds it is refused


async def _fault(stage: FaultStage, _folder: Path) -> None:
    await stage.plant("unplug", "knob", **{"after": SOME_S + 0.5, "for": 2.0})


async def _power_cycle(stage: FaultStage, _folder: Path) -> None:
    """The listener itself is pulled out and comes back with nothing remembered."""
    assert stage.robot.unplug("fan")
    await asyncio.sleep(SOME_S)
    assert stage.robot.plug("fan")


async def _noise(stage: FaultStage, _folder: Path) -> None:
    await stage.plant("loss", "fan", **{"for": 4.0})


async def _mission(stage: FaultStage, _folder: Path) -> None:
    await Played(stage).start(OWN)


async def _mission_refused(stage: FaultStage, _folder: Path) -> None:
    words = await Played(stage).refused("start_mission", mission="mine.toml", toml=OWN, seed=1)
    assert "STOP" in words, words


async def _replay(stage: FaultStage, _folder: Path) -> None:
    """What people did in a recording is done again: the fan driven by hand for longer than STOP holds."""

    async def ask(request: Mapping[str, object]) -> Mapping[str, object]:
        return await perform(stage.operations, request)

    deeds = [
        RecordedOperation(
            step * 1_000_000_000, "Ben", "publish", {"port": "fan.power", "values": ["percent=70"], "seconds": 2.0}
        )
        for step in range(12)
    ]
    player = OperationPlayer(RecordedOperations(tuple(deeds), 0, {}, ""), ask, say=lambda _: None)
    _REPLAYS.append(asyncio.create_task(player.run()))


_REPLAYS: list[asyncio.Task[None]] = []
"""Replays that run: they end with the story."""


async def _by_master(stage: FaultStage) -> None:
    stage.robot.master.say_stop("ann")


async def _by_operation(stage: FaultStage) -> None:
    assert (await stage.operations.do("stop", who="ann", reason="smoke")).answer["stored"]


async def _by_part(stage: FaultStage) -> None:
    knob = stage.robot.simulated("knob")
    assert knob is not None
    knob.part.say_stop()
    while not stage.robot.master.stop.stopped:  # noqa: ASYNC110 - in virtual time
        await asyncio.sleep(0.001)
    assert stage.robot.master.stop.by == "knob"


SAYERS: Mapping[str, Callable[[FaultStage], Awaitable[None]]] = {
    "STOP by the operation that page, API and class call": _by_operation,
    "STOP by a part's program": _by_part,
}
"""How STOP is said, where it is not the master's own word."""

DEEDS: Mapping[str, tuple[Deed, Deed]] = {
    "a changed blueprint is applied, as in a roll-out": (_no_deed, _apply),
    "a blueprint is applied and taken back, by the requests of a roll-out and its undo": (_no_deed, _roll_out_and_undo),
    "a setting is changed": (_no_deed, _set),
    "a setting is changed and reset": (_no_deed, _reset),
    "a slot is added and taken away": (_no_deed, _rewire),
    "somebody drives the fan by hand": (_by_hand, _by_hand),
    "a part falls out and comes back": (_fault, _no_deed),
    "the listening part is reset": (_no_deed, _power_cycle),
    "a fault was planted before": (_noise, _no_deed),
    "a mission runs": (_mission, _no_deed),
    "a mission is begun": (_no_deed, _mission_refused),
    "what people did is replayed": (_replay, _no_deed),
    "a replay is begun": (_no_deed, _replay),
}
"""What is done before STOP, and while it holds."""


def work_story(folder: Path, name: str) -> Verdict:
    """The knob is turned without a pause; STOP; all confirm; a while; GO."""
    begin, meanwhile = DEEDS.get(name, (_no_deed, _no_deed))
    say_stop = SAYERS.get(name, _by_master)
    oracle, verdict = Oracle(), Verdict()
    usual = Part.on

    def on(part: Part, port: str, *more: Any, **options: Any) -> Any:
        register = usual(part, port, *more, **options)

        def decorate(function: Callable[[Any], object]) -> Callable[[Any], object]:
            def hear(message: Any) -> object:
                if part.part_number == "FAN-5V" and message.percent > 0.0:  # and not the safe value, which is 0
                    oracle.heard("the fan")
                return function(message)

            return register(hear)

        return decorate

    async def scene(stage: FaultStage) -> None:
        master = stage.robot.master
        oracle.expect("the fan")
        turning = asyncio.create_task(stage.turn(200.0))
        await asyncio.sleep(1.0)
        await begin(stage, folder)
        await asyncio.sleep(SOME_S)
        verdict.before = oracle.since({})
        await say_stop(stage)
        verdict.confirmed_ms = await until_all_confirm(master, 2)
        at, sent = dict(oracle.counts), _published(stage)
        await meanwhile(stage, folder)
        await asyncio.sleep(4 * SOME_S)
        await until_all_confirm(master, 2)
        verdict.after, verdict.on_the_way = oracle.since(at), _published(stage) - sent
        await stage.operations.do("clear_fault", who="Ada")
        at = dict(oracle.counts)
        master.say_go("ann")
        await asyncio.sleep(2 * SOME_S)
        verdict.again = oracle.since(at)
        for task in (turning, *_REPLAYS):
            task.cancel()
        await asyncio.gather(turning, *_REPLAYS, return_exceptions=True)
        _REPLAYS.clear()

    with mock.patch.object(Part, "on", on):
        fault_scene(folder, scene)
    return verdict


def _published(stage: FaultStage) -> int:
    """Samples on the topics of the robot so far."""
    return sum(published for name, published, _ in stage.robot.master.agent.topics() if name == "fan_power")
