"""Topics as people look at them: messages as they come, to any number of people; a message by hand."""

from __future__ import annotations

import asyncio
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pytest

from msbot.operations.rights import Principal, Role
from msbot.operations.topic_inspection import IDLE_S, MOST_KEPT, WRITER_S
from msbot_agent.space import Qos, Topic
from tests.operations.stage import Stage, play

RING = ("AA=ABCD", "BB=EFGH", "CC=WXYZ")
TOPIC = "HelloWorldTopic_1_to_2"
FREE = ("free_topics = [] ", 'free_topics = ["chat"] ')
pytestmark = pytest.mark.promise("Anybody who may see a robot may see each message of its topics, and only those")


def pupil(name: str) -> Principal:
    return Principal(name, lambda _: None, lambda right: right.least <= Role.STUDENT)


async def samples(stage: Stage, after: int | None = None, **more: object) -> Mapping[str, Any]:
    return (await stage.operations.do("topic_samples", who="ann", topic=TOPIC, after=after, **more)).answer


def test_each_message_comes_with_its_values_and_who_said_it(tmp_path: Path) -> None:
    async def scene(stage: Stage) -> None:
        begun = await samples(stage)
        waiting = asyncio.create_task(samples(stage, begun["next"], wait=3.0))
        await asyncio.sleep(1.0)
        stage.parts["AA"].publish("out", stage.message("one"))
        first = await waiting
        assert [one["fields"] for one in first["samples"]] == [{"index": 1, "message": "one"}]
        assert (first["samples"][0]["slot"], first["type"], first["missed"]) == ("AA", "HelloWorld", 0)
        before = stage.now()
        nothing = await samples(stage, first["next"], wait=2.0)
        assert (nothing["samples"], stage.now() - before) == ([], 2.0)
        stage.parts["AA"].publish("out", stage.message("two"))
        stage.parts["AA"].publish("out", stage.message("three"))
        await asyncio.sleep(0.5)
        other = await samples(stage, begun["next"])  # somebody else, from the start
        assert [one["fields"]["message"] for one in other["samples"]] == ["one", "two", "three"]
        bare = await samples(stage, first["next"], values=False)
        assert [sorted(one) for one in bare["samples"]] == [["at", "octets"]] * 2

    play(tmp_path, scene, parts=RING)


def test_who_reads_slowly_is_told_how_many_are_gone_and_nothing_grows(tmp_path: Path) -> None:
    async def scene(stage: Stage) -> None:
        begun = await samples(stage)
        writer = stage.master.space.writer(Topic(TOPIC, "HelloWorld"), Qos(), bytes(16))
        for number in range(MOST_KEPT + 50):
            writer.write(stage.message(str(number)).encode())
        writer.close()
        told: list[str] = []
        after, missed = begun["next"], 0
        while answer := await samples(stage, after):
            if not answer["samples"]:
                break
            told += [one["fields"]["message"] for one in answer["samples"]]
            after, missed = answer["next"], missed + answer["missed"]
        assert (missed, len(told), told[0], told[-1]) == (50, MOST_KEPT, "50", str(MOST_KEPT + 49))
        await asyncio.sleep(2 * IDLE_S + 1)
        assert stage.operations.topics._watched == {}  # nobody asks any more: nobody listens
        again = await samples(stage, after)
        assert (again["samples"], again["next"]) == ([], 0)

    play(tmp_path, scene, parts=RING)


def test_octets_that_fit_no_message_are_shown_as_octets(tmp_path: Path) -> None:
    async def scene(stage: Stage) -> None:
        begun = await samples(stage)
        writer = stage.master.space.writer(Topic(TOPIC, "HelloWorld"), Qos(), bytes(16))
        writer.write(b"\x01\x02")
        writer.close()
        found = await samples(stage, begun["next"])
        assert found["samples"][0]["fields"]["octets"] == "01 02"
        assert found["samples"][0]["slot"] == ""

    play(tmp_path, scene, parts=RING)


def test_only_the_robots_topics_can_be_seen(tmp_path: Path) -> None:
    async def scene(stage: Stage) -> None:
        names = {one["topic"]: one for one in (await stage.do.topics(who="ann")).answer["topics"]}  # type: ignore[attr-defined]
        assert names["chat"]["free"]
        assert (names[TOPIC]["publishers"], names[TOPIC]["fields"]) == (
            [{"slot": "AA", "port": "out", "part": "ABCD"}],
            [["index", "uint32"], ["message", "text"]],
        )
        for hidden in ("msbot_inventory_Request", "msbot_inventory_Reply", "msbot_masterTopic"):
            assert hidden not in names
            words = await stage.refusal(stage.operations.do("topic_samples", who="ann", topic=hidden, type="x"))
            assert "has no topic" in words
            words = await stage.refusal(stage.operations.do("publish_topic", who="ann", topic=hidden, values=["1"]))
            assert "has no topic" in words
        assert "say which type" in await stage.refusal(stage.operations.do("topic_samples", who="ann", topic="chat"))
        assert "carries HelloWorld, not Level" in await stage.refusal(samples(stage, type="Level"))
        done = await stage.operations.do("topic_samples", who="ann", topic="/chat", type="HelloWorld")
        assert done.answer["type"] == "HelloWorld"
        for wrong, words in (("HeloWorld", "HeloWorld; did you mean HelloWorld?"), ("Xyz", "nobody can say what it")):
            asked = stage.operations.do("publish_topic", who="ann", topic="chat", type=wrong, values=["1"])
            assert words in await stage.refusal(asked)

    play(tmp_path, scene, FREE, parts=RING)


def test_a_message_by_hand_reaches_who_hears_the_topic(tmp_path: Path) -> None:
    async def scene(stage: Stage) -> None:
        done = await stage.operations.do("publish_topic", who="ann", topic=TOPIC, values=["7", "by hand"])
        assert done.words == f"{TOPIC}: index 7, message by hand"
        await stage.operations.do("publish_topic", who="ann", topic=TOPIC, values=["index=8", "message=again"])
        await asyncio.sleep(0.5)
        assert stage.heard["BB"] == ["by hand", "again"]
        lines = [edit.words for edit in await stage.operations.undoing.read(20) if edit.kind == "hand"]
        assert lines == [f"ann publishes on {TOPIC} by hand"]  # one, however many messages
        assert len(stage.operations.topics._writers) == 1
        await asyncio.sleep(WRITER_S + 1)
        assert stage.operations.topics._writers == {}
        for values, words in (
            (["x", "y"], f"{TOPIC}: index must be a whole number, not 'x'"),
            (["1"], "needs a value for message"),
        ):
            asked = stage.operations.do("publish_topic", who="ann", topic=TOPIC, values=values)
            assert words in await stage.refusal(asked)

    play(tmp_path, scene, parts=RING)


@pytest.mark.promise("Nothing is published by hand while STOP holds, the class is frozen, or at another group's slot")
def test_stop_freeze_and_groups_hold_for_a_message_by_hand(tmp_path: Path) -> None:
    async def scene(stage: Stage) -> None:
        def by(who: Principal | str) -> object:
            return stage.operations.do("publish_topic", who=who, topic="/" + TOPIC, values=["1", "no"])

        await stage.do.stop(who="ann")
        assert "STOP is in force" in await stage.refusal(by("ann"))  # type: ignore[arg-type]
        await stage.do.go(who="ann")
        await stage.do.freeze(who="novak")
        assert "frozen" in await stage.refusal(by(pupil("ben")))  # type: ignore[arg-type]
        await stage.do.thaw(who="novak")
        await stage.do.group("Red", ["ada"], ["BB"], who="novak")
        assert await stage.refusal(by(pupil("ben"))) == "slot BB belongs to group Red"  # type: ignore[arg-type]
        await asyncio.sleep(0.5)
        assert stage.heard["BB"] == []
        await by(pupil("ada"))  # type: ignore[misc]
        await asyncio.sleep(0.5)
        assert stage.heard["BB"] == ["no"]

    play(tmp_path, scene, parts=RING)
