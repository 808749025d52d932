"""`msbot bind` and `msbot call`, as people write them who see MsBOT for the first time."""

from __future__ import annotations

import asyncio
from pathlib import Path
from typing import Any

import pytest

from msbot.config import load_library
from msbot.operations.manual_control import read_message
from msbot_xrce.errors import ConfigError
from tests.operations.stage import AA_IS_A_DIAL, Stage, play

SERVICE = "HelloWorld -> HelloWorld"


def test_the_type_is_that_of_the_port_or_of_the_topic(tmp_path: Path) -> None:
    async def scene(stage: Stage) -> None:
        done = await stage.do.bind("echo", "", "AA.echo", [], who="ann")
        assert done.words == "topic echo joins AA.echo"
        topics: Any = (await stage.do.topics(who="ann")).answer["topics"]
        assert {one["topic"]: one["type"] for one in topics}["echo"] == SERVICE
        said = await stage.refusal(stage.do.bind("x", "", "AA.nothing", [], who="ann"))
        assert "the library does not know AA.nothing: name the type, --type" in said

    play(tmp_path, scene, AA_IS_A_DIAL, parts=("AA=DIAL",))


def test_a_wire_that_is_there_is_no_change(tmp_path: Path) -> None:
    async def scene(stage: Stage) -> None:
        first = await stage.do.bind("echo", SERVICE, "AA.echo", [], who="ann")
        again = await stage.do.bind("echo", SERVICE, "AA.echo", [], who="ann")
        assert (first.edit_id is None, again.edit_id) == (False, None)
        assert again.words == "topic echo joins these ports already"

    play(tmp_path, scene, AA_IS_A_DIAL, parts=("AA=DIAL",))


def test_a_port_that_serves_is_told_its_type_with_both_messages(tmp_path: Path) -> None:
    async def scene(stage: Stage) -> None:
        said = await stage.refusal(stage.do.bind("echo", "HelloWorld", "AA.echo", [], who="ann"))
        assert f'is a port of a service: write its type with both messages, "{SERVICE}"' in said

    play(tmp_path, scene, AA_IS_A_DIAL, parts=("AA=DIAL",))


def test_the_wire_that_is_proposed_has_a_name_of_its_own_and_a_call_takes_a_type(tmp_path: Path) -> None:
    async def scene(stage: Stage) -> None:
        await stage.do.unbind("HelloWorldTopic_1_to_2", None, who="ann")
        await stage.do.bind("echo", "HelloWorld", "AA.out", [], who="ann")
        said = await stage.refusal(stage.do.call("AA.echo", ["1", "x"], who="ann"))
        assert "msbot bind AA_echo --type" in said
        await stage.do.bind("AA_echo", "", "AA.echo", [], who="ann")
        await asyncio.sleep(2.0)
        for values in (["HelloWorld", "index=4", "message=hi"], ["HelloWorld", "4", "hi"], ["4", "hi"]):
            done = await stage.do.call("AA.echo", values, who="ann")
            assert done.words == "AA.echo: index 4, message hi"
        said = await stage.refusal(stage.do.call("AA_echo", ["4", "hi"], who="ann"))
        assert "call the port that serves it: msbot call AA.echo VALUE..." in said
        assert "AA.echo has no field" not in said

    play(tmp_path, scene, AA_IS_A_DIAL, parts=("AA=DIAL",))


@pytest.mark.parametrize(
    ("type_name", "values", "words"),
    [
        ("Number", ["1", "2"], r"x takes one value, not 2: value \(float32\)"),
        ("Number", ["Number", "5"], ""),
        ("Text", ["Text", "is", "long"], ""),
    ],
)
def test_values_of_one_field(type_name: str, values: list[str], words: str) -> None:
    message = load_library().messages[type_name]
    if words:
        with pytest.raises(ConfigError, match=words):
            read_message("x", message, values)
        return
    read = read_message("x", message, values)
    assert getattr(read, "value", None) == 5.0 or getattr(read, "text", None) == "Text is long"
