"""The lines that the docs put beside those of can-utils, each run at a bus on which a node talks."""

from __future__ import annotations

import re
import shlex
from pathlib import Path

import pytest

from msbot_agent.link.can.sim.python_can_interface import MsbotBus
from tests import ROOT
from tests.cli.live_bus import bus, invoke, runtime_folder, talking

__all__ = ["bus", "runtime_folder", "talking"]

PAGE = ROOT / "docs/howto/watch_the_bus.md"
TABLE = PAGE.read_text("utf-8").partition("## What can-utils call it")[2].partition("\n## ")[0]
LINES = re.findall(r"\| `msbot bus ([^`]+)` \|", TABLE)
ENDS = {"dump": ("--count", "2"), "load": ("--seconds", "1")}
"""What ends a line that goes on until Ctrl-C."""


def test_the_table_has_its_lines() -> None:
    assert [line.split()[0] for line in LINES] == ["dump", "dump", "dump", "send", "load"]


@pytest.mark.parametrize("line", LINES)
def test_each_line_works(talking: MsbotBus, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, line: str) -> None:
    monkeypatch.chdir(tmp_path)
    first, *words = shlex.split(line.replace("can0", "sim:bench1"))
    ends = () if "--count" in words else ENDS.get(first, ())
    said = invoke(first, *words, *ends).stdout
    assert "103" in said or first == "send"
    assert ("--log" in words) is (tmp_path / "bus.log").exists()
