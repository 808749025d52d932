"""The robot of the page "Try it in this tab", in virtual time; in a real tab: tests/test_tab.py."""

from __future__ import annotations

import asyncio
import json
import subprocess
import sys
from collections.abc import Awaitable, Callable
from functools import partial
from random import Random
from typing import Any

from msbot.process.virtual_time import run_virtual
from msbot_school.demo.tab_robot import FIRST_LINES, TabRobot

MISSING = ("ssl", "sqlite3", "fcntl", "lzma", "termios", "resource", "_multiprocessing")
"""Modules of the standard library that Pyodide does not bring."""


def test_it_needs_nothing_that_a_tab_lacks() -> None:
    blocked = f"""
import sys
sys.modules.update(dict.fromkeys({MISSING}))
before = set(sys.modules)
from msbot_school.demo.tab_robot import tab_library
tab_library()
own = set(sys.stdlib_module_names) | {{"msbot", "msbot_agent", "msbot_xrce", "msbot_school"}}
print(sorted({{name.partition(".")[0] for name in set(sys.modules) - before}} - own))
"""
    done = subprocess.run([sys.executable, "-c", blocked], capture_output=True, text=True, check=False)
    assert (done.stdout, done.stderr) == ("[]\n", "")


class Visitor:
    """Who looks at the page."""

    def __init__(self) -> None:
        self.looks: list[dict[str, Any]] = []
        self.tab = TabRobot(lambda text: self.looks.append(json.loads(text)), Random(1))

    @property
    def seen(self) -> dict[str, Any]:
        return self.looks[-1]

    def part(self, name: str) -> dict[str, Any]:
        (found,) = (one for one in self.seen["parts"] if one["name"] == name)
        assert isinstance(found, dict)
        return found

    def reading(self, name: str) -> Any:
        return self.part(name)["readings"][0]["value"]

    def do(self, what: str, **more: Any) -> str:
        self.tab.act(json.dumps({"do": what, **more}))
        return str(self.seen["answer"])

    def run(self, lines: str) -> None:
        assert self.do("run", lines=lines) == ""

    async def until(self, is_so: Callable[[], bool]) -> None:
        for _ in range(200):
            await asyncio.sleep(0.1)
            if is_so():
                return
        raise AssertionError(json.dumps(self.seen, indent=1))


def visit(scene: Callable[[Visitor], Awaitable[None]]) -> None:
    async def main() -> None:
        visitor = Visitor()
        running = asyncio.create_task(visitor.tab.run())
        states = {"knob": "active", "fan": "active", "lamp": "active", "yours": "new", "spare fan": "standby"}
        await asyncio.sleep(0.1)
        await visitor.until(lambda: {one["name"]: one["state"] for one in visitor.seen["parts"]} == states)
        await scene(visitor)
        running.cancel()
        await asyncio.gather(running, return_exceptions=True)

    run_virtual(main())


def test_a_spare_takes_over_and_the_part_that_comes_back_stands_by() -> None:
    async def scene(visitor: Visitor) -> None:
        assert visitor.do("pull", place="fan") == ""
        assert not visitor.part("fan")["plugged"]
        await visitor.until(lambda: visitor.part("spare fan")["slot"] == "fan")
        assert "takes over slot fan" in visitor.part("spare fan")["reason"]
        assert [one["to_state"] for one in visitor.seen["events"] if one["part"] == "fan"][-2:] == ["late", "lost"]
        visitor.do("plug", place="fan")
        await visitor.until(lambda: visitor.part("fan")["state"] == "standby")

    visit(scene)


def test_three_lines_join_and_switch_the_lamp() -> None:
    async def scene(visitor: Visitor) -> None:
        visitor.run(FIRST_LINES)
        await visitor.until(lambda: visitor.part("yours")["state"] == "active")
        visitor.do("set", place="knob", control="knob", value=80)
        await visitor.until(lambda: visitor.reading("lamp") is True)
        assert visitor.reading("fan") > 0
        visitor.do("set", place="knob", control="knob", value=20)
        await visitor.until(lambda: visitor.reading("lamp") is False)
        assert visitor.seen["program"] == []
        assert any("knob says level" in one["words"] for one in visitor.seen["frames"])
        visitor.run('@part.on("knob", Level)\ndef show(level):\n    print("the knob is at", level.percent)')
        await visitor.until(lambda: any(line.startswith("the knob is at ") for line in visitor.seen["program"]))
        visitor.do("pull", place="yours")
        await visitor.until(lambda: visitor.part("yours")["state"] == "lost")

    visit(scene)


def test_stop_holds_until_go() -> None:
    async def scene(visitor: Visitor) -> None:
        visitor.do("set", place="knob", control="knob", value=90)
        await visitor.until(lambda: visitor.reading("fan") > 3000)
        visitor.do("stop")
        await visitor.until(lambda: len(visitor.seen["stop"]["confirmed"]) == 3)
        assert visitor.seen["stop"]["silent"] == []
        await visitor.until(lambda: visitor.reading("fan") == 0)
        assert visitor.do("go") == ""
        await visitor.until(lambda: visitor.reading("fan") > 3000)
        assert visitor.do("go") == "nobody said STOP: there is nothing to end"

    visit(scene)


MISTAKES = [
    ("def light(:", "yours.py:5: invalid syntax"),
    ('@part.on("knob")\ndef light(level): pass', "yours.py:5: "),
    ("part = 3", "yours.py: the name `part` must stay the part of the first lines"),
    ('part.calls("knob", Level, Switch)', "yours.py: part.calls: nobody in this robot answers"),
    ("1 / 0", "ZeroDivisionError: yours.py:5: division by zero"),
    ('@part.on("nob", Level)\ndef light(level): pass', "port 'nob': nothing will come in; bound in this robot: knob"),
    ('@part.on("knob", Level)\ndef light(level): level.volume', "yours.py:6 in light: AttributeError: "),
    ("@part.every(0.1)\ndef speak(): part.publish('lamp', Switch(on=True))", "yours.py:6 in speak: "),
]


def test_a_mistake_is_a_sentence_and_the_robot_goes_on() -> None:
    async def scene(visitor: Visitor) -> None:
        for lines, words in MISTAKES:
            visitor.run(lines)
            await visitor.until(partial(tells, visitor, words))
        visitor.run(FIRST_LINES)
        assert told_by(visitor) == []
        await visitor.until(lambda: visitor.part("yours")["state"] == "active")
        assert visitor.part("knob")["state"] == "active"

    visit(scene)


def tells(visitor: Visitor, words: str) -> bool:
    return any(words in line for line in told_by(visitor))


def told_by(visitor: Visitor) -> list[str]:
    """What the page shows below the program."""
    return [*visitor.seen["program"], *visitor.seen["log"]]


def test_what_the_page_may_not_say() -> None:
    async def scene(visitor: Visitor) -> None:
        assert "does not understand" in visitor.do("fly")
        assert "there is no part 'wing'" in visitor.do("pull", place="wing")
        visitor.do("pull", place="knob")
        assert visitor.do("set", place="knob", control="knob", value=1) == "knob is not plugged in"
        assert "at most 20000 octets" in visitor.do("run", lines="#" * 20_001)

    visit(scene)
