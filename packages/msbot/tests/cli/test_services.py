"""What services bring to the command line of a master or an agent, and what is left out."""

from __future__ import annotations

import asyncio
import re
from collections.abc import Callable, Iterable, Iterator, Mapping
from typing import Any

import click
import pytest
from click.testing import CliRunner, Result

from msbot_agent.cli.command_services import Beside, CommandService, ServedCommand, WantedService, wanted_services
from msbot_agent.startup.extensions import Extension, Extensions
from msbot_xrce.errors import ConfigError


class Words(CommandService[str, list[str]]):
    """Adds `--NAME TEXT`, and puts the text into the list that is its context."""

    def __init__(self, name: str, *after: str) -> None:
        self.name, self.after = name, after
        self.options = (click.option(f"--{name}"),)

    def check(self, given: Mapping[str, Any]) -> str | None:
        text: str | None = given[self.name]
        if text == "wrong":
            raise ConfigError(f"--{self.name} wrong makes no sense")
        if text == "broken":
            raise ZeroDivisionError(text)
        return text

    def coroutines(self, wanted: str, context: list[str]) -> Iterable[Beside]:
        if wanted == "late":
            raise ZeroDivisionError(wanted)
        context.append(wanted)
        return [self.run(wanted, context)]

    async def run(self, wanted: str, context: list[str]) -> None:
        context.append(f"{wanted} runs")
        if wanted == "dies":
            raise ZeroDivisionError(wanted)


Brought = Callable[..., Extensions]


def brought(*services: tuple[str, object], own: bool = False) -> Extensions:
    """Services, as some package brings them."""

    def load(found: object) -> object:
        if isinstance(found, Exception):
            raise found
        return found

    def find() -> Iterator[Extension]:
        for name, found in services:
            package = "msbot 1" if own else "stranger 1"
            yield Extension("services", name, package, "", lambda found=found: load(found))  # type: ignore[misc]

    return Extensions(find)


def call(found: Extensions, *arguments: str) -> tuple[Result, list[WantedService]]:
    """Call a command with these services."""
    wanted = list[WantedService]()

    class Command(ServedCommand):
        group = "services"
        find = staticmethod(lambda: found)

    @click.command("robot", cls=Command)
    @click.option("--own")
    def command(own: str | None) -> None:
        wanted.extend(wanted_services())
        click.echo(f"own {own}")

    return CliRunner().invoke(command, arguments), wanted


def left_out(found: Extensions) -> dict[str, str]:
    return {one.name: why for one, why in found.listed() if why}


def beside(wanted: list[WantedService]) -> list[str]:
    """Run them until they end; what they did."""
    done = list[str]()

    async def main() -> None:
        await asyncio.gather(*(one for service in wanted for one in service.coroutines(done)))

    asyncio.run(main())
    return done


def test_the_command_has_their_options_and_its_function_has_not() -> None:
    found = brought(("one", Words("first")), ("two", Words("second")))
    done, wanted = call(found, "--first", "a", "--own", "b")
    assert done.output == "own b\n"
    assert beside(wanted) == ["a", "a runs"], "the other one is not wanted"
    assert "--second" in call(found, "--help")[0].output
    done, _ = call(brought(), "--first", "a")
    assert done.exit_code == 2
    assert "No such option: --first" in done.output or "No such option '--first'" in done.output


def test_they_come_in_the_order_that_they_name() -> None:
    found = brought(("a", Words("first", "c", "not-installed")), ("b", Words("second")), ("c", Words("third", "b")))
    _, wanted = call(found, "--first", "1", "--second", "2", "--third", "3")
    assert [one.wanted for one in wanted] == ["2", "3", "1"]
    circle = brought(("a", Words("first", "b")), ("b", Words("second", "a")))
    assert [one.wanted for one in call(circle, "--first", "1", "--second", "2")[1]] == ["1", "2"]


def test_a_wrong_option_is_told_before_anything_runs() -> None:
    done, wanted = call(brought(("one", Words("first"))), "--first", "wrong")
    assert isinstance(done.exception, ConfigError)
    assert str(done.exception) == "--first wrong makes no sense"
    assert wanted == []


def test_what_a_stranger_brings_and_does_not_work_is_left_out() -> None:
    twice, text, missing = Words("own"), "a text", ImportError("no way")
    found = brought(("good", Words("first")), ("missing", missing), ("text", text), ("twice", twice))
    done, wanted = call(found, "--first", "a")
    assert done.output == "own None\n"
    assert beside(wanted) == ["a", "a runs"]
    assert left_out(found) == {
        "missing": "ImportError: no way",
        "text": "it is a str, not a CommandService",
        "twice": "the command has --own already",
    }


@pytest.mark.parametrize("when", ["broken", "late", "dies"])
def test_the_robot_runs_on_without_a_strangers_service_that_fails(when: str) -> None:
    found = brought(("bad", Words("first")), ("good", Words("second")))
    done, wanted = call(found, "--first", when, "--second", "b")
    assert done.exit_code == 0
    assert "b runs" in beside(wanted)
    (why,) = left_out(found).values()
    assert re.fullmatch(rf"ZeroDivisionError: {when} \(test_services\.py:\d+ in \w+\)", why)


@pytest.mark.parametrize("when", ["late", "dies"])
def test_a_service_of_its_own_that_fails_is_no_secret(when: str) -> None:
    _, wanted = call(brought(("bad", Words("first")), own=True), "--first", when)
    with pytest.raises(ZeroDivisionError):
        beside(wanted)
