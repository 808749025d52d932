"""`msbot call`: people and pages ask a port that serves; each call ends with its reply or a sentence."""

from __future__ import annotations

import asyncio
from pathlib import Path

import pytest
from click.testing import CliRunner

from msbot.cli.topic import topic_commands
from msbot.operations.service_calls import MOST_OPEN
from msbot.part import HelloWorld
from msbot.pnp import Freeze
from msbot_xrce.errors import CallError
from tests.operations.stage import AA_IS_A_DIAL, DIAL, Stage, play

TYPE = "HelloWorld -> HelloWorld"
LOOK = 'name = "look"\ndirection = "serve"\nrequest = "Angle"\nreply = "Reach"'
REACH = """
[[type]]
name = "Reach"
fields = { span = "float32", last = "Distance" }
units = { span = "cm" }
"""


async def wired(stage: Stage) -> None:
    await stage.do.bind("echo", TYPE, "AA.echo", [], who="ann")
    await asyncio.sleep(2.0)


def test_a_person_calls_and_reads_the_reply(tmp_path: Path) -> None:
    async def scene(stage: Stage) -> None:
        await wired(stage)
        done = await stage.do.call("aa.echo", ["index=4", "message=hello"], who="ann")
        assert done.words == "AA.echo: index 4, message hello"
        assert done.answer == {"reply": {"index": 4, "message": "hello"}}

    play(tmp_path, scene, AA_IS_A_DIAL, parts=("AA=DIAL",))


def test_what_cannot_be_called_is_said_in_one_sentence(tmp_path: Path) -> None:
    async def scene(stage: Stage) -> None:
        async def refusal(port: str, *values: str) -> str:
            return await stage.refusal(stage.do.call(port, values or ("1", "x"), who="ann"))

        assert await refusal("AA.echo") == (
            "no wire leads to AA.echo: make one, for example msbot bind echo --type 'HelloWorld -> HelloWorld' "
            "--from AA.echo"
        )
        await wired(stage)
        assert await refusal("AA.out") == "AA.out is not a port that serves; those of DIAL: AA.echo"
        assert (
            await refusal("AA.ask") == "AA.ask is a port that calls; name the port that it calls: none is wired to it"
        )
        assert await refusal("AA.echo", "one", "x") == "AA.echo: index must be a whole number, not 'one'"
        stage.parts["AA"]._program.servers.clear()
        assert "has no function for it: write @part.serves(...)" in await refusal("AA.echo")
        inventory, now = stage.master.inventory, asyncio.get_running_loop().time()
        inventory._index.sessions[inventory._index.holders["AA"].client_key].pupil = "ben"
        inventory.pupil_parts.pupils.freeze = Freeze("ann", "look at me", now)
        words = "nobody serves AA.echo now: slot AA is held: the class is frozen by ann: look at me"
        assert await refusal("AA.echo") == words
        inventory.pupil_parts.pupils.freeze = None
        stage.master.say_stop("ann")
        await asyncio.sleep(1.0)
        stage.parts["AA"].serves("echo", HelloWorld, HelloWorld)(lambda request: request)
        assert await refusal("AA.echo") == "call of AA.echo: STOP is in force: call again after GO"
        stage.pull("AA")
        await asyncio.sleep(12.0)
        assert await refusal("AA.echo") == "nobody serves AA.echo now: slot AA is empty"

    play(tmp_path, scene, AA_IS_A_DIAL, parts=("AA=DIAL",))


@pytest.mark.promise("Nobody has a part do something while STOP holds")
def test_a_part_that_has_not_heard_of_stop_yet_is_asked_nothing(tmp_path: Path) -> None:
    async def scene(stage: Stage) -> None:
        served: list[HelloWorld] = []

        def echo(request: HelloWorld) -> HelloWorld:
            served.append(request)
            return request

        stage.parts["AA"]._program.servers.clear()
        stage.parts["AA"].serves("echo", HelloWorld, HelloWorld)(echo)
        await wired(stage)
        stage.master.say_stop("ann")
        await asyncio.sleep(1.0)
        stage.parts["AA"]._runner.safety.stopped = False
        refused = await stage.refusal(stage.do.call("AA.echo", ["1", "x"], who="ann"))
        assert refused == "call of AA.echo: STOP is in force: call again after GO"
        assert served == []

    play(tmp_path, scene, AA_IS_A_DIAL, parts=("AA=DIAL",))


@pytest.mark.promise("A call ends with its reply, or with one sentence, never without an end")
def test_a_part_that_never_answers_and_people_who_ask_again_and_again(tmp_path: Path) -> None:
    async def scene(stage: Stage) -> None:
        await wired(stage)
        membership = stage.parts["AA"]._runner._membership
        assert membership is not None
        membership.client._on_request = lambda *_: None
        calls = [
            stage.operations.do("call", who="ann", port="AA.echo", values=["1", "x"], seconds=1.0)
            for _ in range(MOST_OPEN + 3)
        ]
        ends = await asyncio.gather(*calls, return_exceptions=True)
        assert all(isinstance(end, CallError) for end in ends)
        assert sum("no reply within 1 s" in str(end) for end in ends) == MOST_OPEN
        assert sum(f"{MOST_OPEN} calls wait for replies already" in str(end) for end in ends) == 3

    play(tmp_path, scene, AA_IS_A_DIAL, parts=("AA=DIAL",))


def test_a_service_is_shown_with_the_fields_and_units_of_request_and_reply(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    found: dict[str, object] = {}
    dial = (
        DIAL.replace('name = "echo"\ndirection = "serve"\nrequest = "HelloWorld"\nreply = "HelloWorld"', LOOK) + REACH
    )
    assert dial != DIAL + REACH

    async def scene(stage: Stage) -> None:
        await stage.do.bind("look", "Angle -> Reach", "AA.look", [], who="ann")
        (one,) = [one for one in (await stage.do.topics(who="ann")).answer["topics"] if one["topic"] == "look"]  # type: ignore[attr-defined]
        found.update(one)

    play(tmp_path, scene, AA_IS_A_DIAL, parts=("AA=DIAL",), dial=dial)
    monkeypatch.setattr(topic_commands.RobotTopics, "topic", lambda *_: found)
    monkeypatch.setattr(topic_commands.RobotTopics, "__init__", lambda *_: None)
    assert CliRunner().invoke(topic_commands.command, ["info", "look", "-v"]).output.splitlines() == [
        "Type: Angle -> Reach",
        "Request: Angle",
        "  degrees: float32 °",
        "Reply: Reach",
        "  span: float32 cm",
        "  last: Distance",
        "    metres: float32 m",
        "    in_range: bool",
        "Server count: 1",
        "  AA.look  (DIAL)",
        "Client count: 0",
        "Requests so far: 0 delivered",
    ]
