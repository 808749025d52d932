"""Log lines for programs and for systemd's journal, and how much each room says."""

from __future__ import annotations

import io
import json
import logging
import os
import sys
from pathlib import Path

import pytest
from click.testing import CliRunner

from msbot.cli.run.master_services import log_event, log_stop
from msbot.operations.dispatch import PerformedOperation
from msbot.pnp.part_events import PartEvent, PartState
from msbot_agent.cli.logs import EVENTS, LogOptions, RoomLevel
from msbot_agent.log import BURST, JournalFormatter, JsonFormatter, TerminalHandler, goes_to_journal
from msbot_agent.process.user_folders import room_of


def record(level: int, text: str, name: str = "msbot_agent.agent.server") -> logging.LogRecord:
    return logging.LogRecord(name, level, "x.py", 1, text, None, None)


def test_a_line_for_programs_is_one_object_whatever_the_message_holds() -> None:
    line = JsonFormatter().format(record(logging.WARNING, 'a "name"\nwith\x1b[31m and \u2028'))
    assert line.isascii()
    assert line.count("\n") == 0
    found = json.loads(line)
    assert found["message"] == 'a "name"\nwith\x1b[31m and \u2028'
    assert (found["level"], found["room"], found["logger"]) == ("warning", "agent", "msbot_agent.agent.server")


def test_rooms_of_loggers() -> None:
    names = ("msbot_web.api.routes", "msbot_agent.link.base", "msbot", "uvicorn.error", "asyncio")
    assert [room_of(name) for name in names] == ["web", "link", "msbot", "uvicorn", "asyncio"]


def test_lines_for_the_journal_have_their_priority_and_forge_none() -> None:
    form = JournalFormatter().format
    assert form(record(logging.ERROR, "it fails")) == "<3>it fails"
    assert form(record(logging.DEBUG, "a detail")) == "<7>a detail"
    assert form(record(logging.INFO, "part\n<0>panic")) == "<6>part\\n<0>panic"
    try:
        raise ValueError("x")
    except ValueError:
        failed = record(logging.CRITICAL, "it broke")
        failed.exc_info = sys.exc_info()
    assert all(line.startswith("<2>") for line in form(failed).splitlines())


def test_the_journal_is_recognised_by_its_stream(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    with (tmp_path / "journal").open("w") as stream:
        monkeypatch.setattr(sys, "stderr", stream)
        status = os.fstat(stream.fileno())
        monkeypatch.setenv("JOURNAL_STREAM", f"{status.st_dev}:{status.st_ino}")
        assert goes_to_journal(sys.stderr)
        monkeypatch.setenv("JOURNAL_STREAM", f"{status.st_dev}:{status.st_ino + 1}")
        assert not goes_to_journal(sys.stderr)
    for nonsense in ("", "12", "a:b"):
        monkeypatch.setenv("JOURNAL_STREAM", nonsense)
        assert not goes_to_journal(sys.stderr)


def test_events_of_parts_in_slots_are_all_written_and_those_of_strangers_counted() -> None:
    stream = io.StringIO()
    handler = TerminalHandler(stream=stream)
    handler.setFormatter(JsonFormatter())
    logger = logging.getLogger(EVENTS)
    logger.addHandler(handler)
    logger.setLevel(logging.INFO)
    try:
        for slot in ("AA", None):
            for number in range(2 * BURST):
                log_event(PartEvent(1.0, f"P{number}", slot, PartState.NEW, PartState.LATE, "no beat"))
    finally:
        logger.removeHandler(handler)
        logger.setLevel(logging.NOTSET)
    found = [json.loads(line) for line in stream.getvalue().splitlines()]
    assert sum(one["slot"] == "AA" for one in found) == 2 * BURST
    assert sum(one["slot"] == "" for one in found) == BURST
    assert {key: found[0][key] for key in ("part", "from", "to", "reason")} == {
        "part": "P0",
        "from": "new",
        "to": "late",
        "reason": "no beat",
    }


def test_who_says_stop_and_go_is_in_the_log(caplog: pytest.LogCaptureFixture) -> None:
    with caplog.at_level(logging.INFO, EVENTS):
        for who, operation, words in (
            ("ann", "stop", "STOP by ann, from a page: smoke"),
            ("ann", "set", "fan.speed is 3"),
            ("bob", "go", "bob ended STOP"),
        ):
            log_stop(PerformedOperation(who, operation, {}, words))
    lines = [json.loads(JsonFormatter().format(record)) for record in caplog.records]
    assert [(one["operation"], one["who"], one["message"]) for one in lines] == [
        ("stop", "ann", "STOP by ann, from a page: smoke"),
        ("go", "bob", "bob ended STOP"),
    ]


def test_rooms_get_the_levels_that_are_asked_for() -> None:
    read = RoomLevel().convert
    assert read("agent=debug", None, None) == ("agent", logging.DEBUG)
    assert read("error", None, None) == ("", logging.ERROR)
    logger = logging.getLogger("msbot_agent.idl")
    before = logger.level
    try:
        LogOptions(levels=(("idl", logging.DEBUG),)).apply()
        assert logger.level == logging.DEBUG
    finally:
        logger.setLevel(before)


@pytest.mark.parametrize(
    ("wish", "right"),
    [
        ("kitchen=debug", "there is no room 'kitchen'; there are agent, "),
        ("loud", "'loud' is no level; there are debug"),
    ],
)
def test_a_wrong_level_is_one_sentence_with_what_would_be_right(wish: str, right: str) -> None:
    from msbot.cli.run.master import command

    done = CliRunner().invoke(command, ["--log-level", wish])
    assert done.exit_code == 2
    assert right in done.output
