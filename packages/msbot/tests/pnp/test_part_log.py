"""`part.log`: from a part's program to the robot's log, bounded in length and rate, and only from an active part."""

from __future__ import annotations

import asyncio
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from msbot import Part
from msbot.part.join.hardware_trouble import TroublePiece
from msbot.part.join.part_log import BURST, LONGEST_LINE, LineRate, LogLevel, LogSender, VersionOf, printable
from msbot.pnp.inventory_record import InventoryRecord
from msbot.pnp.model import THESIS_TIMING
from msbot.pnp.part_log import BURST as MASTERS_BURST
from msbot_xrce.errors import ConfigError
from tests.operations.stage import AA_IS_A_DIAL, Stage, play


def heard(sender: LogSender, record: InventoryRecord) -> list[tuple[LogLevel | VersionOf, str]]:
    """What of the sender's lines reaches the record."""
    lines = []
    for octets in sender.pieces(7):
        piece = TroublePiece.decode(octets)
        assert piece.lease == 7
        if (line := record.take_piece(piece.place, piece.text)) is not None:
            lines.append(line)
        sender.sent()
    return lines


def record() -> InventoryRecord:
    return InventoryRecord(1, "wire", THESIS_TIMING, 0.0)


def test_versions_go_before_the_lines_that_wait_and_are_no_lines() -> None:
    sender = LogSender()
    sender.add(LogLevel.INFO, "a line", 0.0)
    for of, text in ((VersionOf.SOFTWARE, "2.1\n"), (VersionOf.HARDWARE, "")):
        sender.add_version(of, text)
    assert heard(sender, record()) == [
        (VersionOf.HARDWARE, " "),
        (VersionOf.SOFTWARE, "2.1 "),
        (LogLevel.INFO, "a line"),
    ]


@given(st.text(), st.sampled_from(LogLevel))
def test_a_line_arrives_as_it_was_said_or_cut(text: str, level: LogLevel) -> None:
    sender, line = LogSender(), printable(text)
    sender.add(level, line, now=0.0)
    ((told, words),) = heard(sender, record())
    assert told is level
    assert words == (line or " ")
    assert len(line.encode(errors="replace")) <= LONGEST_LINE


def test_lines_that_come_too_fast_are_counted_and_told() -> None:
    sender, of_part = LogSender(), record()
    for number in range(100):
        sender.add(LogLevel.INFO, str(number), now=1.0)
    assert sender.dropped == 100 - BURST
    assert [words for _, words in heard(sender, of_part)] == [str(number) for number in range(int(BURST))]
    sender.add(LogLevel.INFO, "later", now=2.0)
    assert heard(sender, of_part) == [
        (LogLevel.WARNING, "80 lines were left out: 5 a second are sent"),
        (LogLevel.INFO, "later"),
    ]
    assert not of_part.trouble, "a line of a log is no trouble with hardware"


def test_a_wrong_level_is_named() -> None:
    with pytest.raises(ConfigError, match=r"level='loud'.*'info', 'warning' or 'error'"):
        Part("ABCD").log("hello", level="loud")


async def told(stage: Stage) -> list[tuple[object, ...]]:
    lines = (await stage.do.log_lines(None, 200, who="ann")).answer["lines"]
    assert isinstance(lines, list)
    return [(one["slot"], one["level"], one["words"]) for one in lines if one["kind"] == "program"]


def test_the_robot_shows_what_a_program_logs(tmp_path: Path) -> None:
    async def scene(stage: Stage) -> None:
        part = stage.parts["AA"]
        part.log("it is warm")
        part.log("too hot: 81 °C", level="warning")
        part.log("the fan\nis stuck", level="error")
        await asyncio.sleep(1)
        assert await told(stage) == [
            ("AA", "info", "AA: it is warm"),
            ("AA", "warning", "AA: too hot: 81 °C"),
            ("AA", "error", "AA: the fan is stuck"),
        ]
        assert [line.words for line in stage.master.inventory.lines_of("AA")] == [
            "it is warm",
            "too hot: 81 °C",
            "the fan is stuck",
        ]
        assert "its program says: too hot: 81 °C" in stage.master.why("AA")
        noted = [event.reason for event in stage.events if event.part == "AA"]
        assert noted.count("its program says: the fan is stuck") == 1, "the journal has the error, once"
        part.log("again", level="error")
        await asyncio.sleep(1)
        assert not [one for one in stage.events if one.reason.endswith("again")], "one error a minute"
        stage.pull("AA")
        await asyncio.sleep(20)
        part.log("nobody hears that")
        assert (await told(stage))[-1] == ("AA", "error", "AA: again")

    play(tmp_path, scene, AA_IS_A_DIAL, parts=("AA=DIAL",))


@pytest.mark.promise("What one part logs is bounded, however much it sends")
def test_a_program_of_others_that_floods_the_log(tmp_path: Path) -> None:
    async def scene(stage: Stage) -> None:
        membership = stage.parts["AA"]._runner._membership
        assert membership is not None
        membership.log._rate = LineRate(1e9, 1e9)  # a client that does not care
        for number in range(40):
            for _ in range(10):
                stage.parts["AA"].log(f"line {number}")
            await asyncio.sleep(0.05)
        await asyncio.sleep(1)
        assert len(await told(stage)) <= MASTERS_BURST + 10 * 3.0
        assert stage.master.inventory.dropped["line of a part's log that comes too fast"] > 100

    play(tmp_path, scene, AA_IS_A_DIAL, parts=("AA=DIAL",))
