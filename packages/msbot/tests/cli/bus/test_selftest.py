"""`msbot bus selftest`: what it says, and its status."""

from __future__ import annotations

import json

import pytest
from click.testing import CliRunner

from msbot.cli.bus import selftest as bus_selftest
from msbot.cli.bus.bus_commands import command
from msbot_agent.link.can.controller import CanBus
from msbot_agent.link.can.self_test import CheckResult


def test_every_check_is_a_line() -> None:
    result = CliRunner().invoke(command, ["selftest", "--frames", "50"])
    assert result.exit_code == 0
    lines = result.output.splitlines()
    assert len(lines) == 5
    assert all(line.startswith("passed  ") for line in lines[:4])
    assert lines[4].startswith("350 frames in 0.0")


def test_the_checks_as_json() -> None:
    result = CliRunner().invoke(command, ["selftest", "--frames", "50", "--json"])
    assert result.exit_code == 0
    answer = json.loads(result.stdout)
    assert answer["passed"] is True
    assert len(answer["checks"]) == 4
    assert set(answer["checks"][0]) == {"name", "passed", "words"}
    assert (answer["bitrate"], answer["frames"]) == (500_000, 350)


def test_a_failed_check_is_status_1(monkeypatch: pytest.MonkeyPatch) -> None:
    async def failing(one: CanBus, other: CanBus, *, frames: int) -> list[CheckResult]:
        return [CheckResult("order", False, "frame 3 is 00 and not 01")]

    monkeypatch.setattr(bus_selftest, "selftest", failing)
    result = CliRunner().invoke(command, ["selftest"])
    assert result.exit_code == 1
    assert result.output.startswith("FAILED  order: frame 3 is 00 and not 01\n")
    result = CliRunner().invoke(command, ["selftest", "--json"])
    assert result.exit_code == 1
    assert json.loads(result.stdout)["passed"] is False
