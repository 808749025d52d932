"""`msbot bus decode`: a log of the sample robot, line by line in words."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from click.testing import CliRunner

from msbot.cli.bus.bus_commands import command
from msbot_agent.cli import main
from tests.e2e.processes import run


def decoded(*arguments: str, log: str | None = None) -> list[str]:
    result = CliRunner().invoke(command, ["decode", *arguments], input=log)
    assert result.exit_code == 0, result.output
    return result.stdout.splitlines()


def test_words_stand_beside_the_frame_and_the_packet_below() -> None:
    log = "(1700000000.123456) can0 101#C181010700\n(1700000000.3) can0 7FF#1122\n"
    assert decoded(log=log) == [
        " (1700000000.123456)  can0       101   [5]  C1 81 01 07 00          node 1 to master, SE  1: 4 bytes",
        " " * 72 + "session 0x81, best-effort stream 0x01, message 7",
        " (1700000000.300000)  can0       7FF   [2]  11 22                   foreign",
    ]


def test_what_candump_shows_can_be_piped_in() -> None:
    lines = decoded(log="  can0  008   [1]  01\n  can0  7FF  [02]  11 22\n")
    assert [re.split(r"  +", line.strip())[-1] for line in lines] == ["STOP: STOP was pressed", "foreign"]
    assert lines[0].startswith(" can0       008   [1]  01 ")


def test_the_thesis_framing_is_decoded_on_demand() -> None:
    frames = ("0380000000000110", "0200585243450100", "01010FBA5EBA1181", "0000EC05")
    lines = decoded("--legacy", log="".join(f"(1.0) can0 123#{data}\n" for data in frames))
    assert lines[3].endswith("component to master, 0: 24 bytes")
    assert lines[5].strip() == "CREATE_CLIENT BA5EBA11: wants session 0x81, messages of at most 1516 bytes"


def test_a_long_fd_frame_pushes_the_words_out() -> None:
    (line,) = decoded(log=f"(1.0) can0 7FF##1{'AA' * 64}\n")
    assert line.endswith("AA  foreign")


def test_unreadable_lines_are_told_at_the_end() -> None:
    result = CliRunner().invoke(command, ["decode"], input="(1.0) can0 123#11\nwhat?\n")
    assert result.exit_code == 0
    assert result.stderr == (
        "msbot: 1 of 2 lines were no frames; line 2: 'what?' is not a line of candump, "
        "such as (1700000000.123456) can0 123#DEADBEEF\n"
    )


def test_a_missing_log_is_one_sentence_and_status_2(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("sys.argv", ["msbot", "bus", "decode", "absent.log"])
    with pytest.raises(SystemExit) as caught:
        main()
    assert caught.value.code == 2
    assert capsys.readouterr().err == "msbot: cannot read absent.log: No such file or directory\n"


@pytest.mark.parametrize("options", [(), ("--no-compression",), ("--link", "fd")])
def test_the_log_of_the_demo_tells_the_whole_story(options: tuple[str, ...], tmp_path: Path) -> None:
    """From the first BEACON to the ring at work, end to end, through the commands themselves."""
    path = tmp_path / "bus.log"
    for seconds in (2.5, 30.0):  # beside much other work a robot begins late
        done = run("demo", "--robot", "thesis", "--seconds", str(seconds), "--json", "--log", str(path), *options)
        assert done.returncode == 0, done.stderr
        told = run("bus", "decode", str(path))
        assert told.returncode == 0, told.stderr
        assert told.stderr == ""
        if "reply of msbot_inventory: BeatReply" in told.stdout:
            break
    story = (
        r"BEACON: robot \w+, epoch \d+",
        r"JOIN: part \w+ asks for an address",
        r"ASSIGN: part \w+ is node 1, epoch \d+",
        r"CREATE_CLIENT \w+: wants session 0x81",
        r"STATUS_AGENT: OK",
        r"CREATE requester 0x0017, .* service 'msbot_inventory'",
        r"msbot_masterTopic: ProfileMessage\(index=\d+, message='MSBOT_MASTER'",
        r"request of msbot_inventory: Claim\(part_number='\w+', local_name='\w+-local'",
        r"reply of msbot_inventory: Verdict\(lease=\d+, configuration_version=1, beat_period_ms=1000",
        r"request of msbot_inventory: ConfigurationRequest\(lease=\d+, have_version=0\)",
        r"reply of msbot_inventory: Configuration\(version=1, slot='\w\w'",
        r"HelloWorldTopic_1_to_2: HelloWorld\(index=\d+, message='Publisher A\(1\) turn-on \d'\)",
        r"request of msbot_inventory: Beat\(lease=\d+\)",
        r"reply of msbot_inventory: BeatReply\(configuration_version=1\)",
    )
    place = 0
    for words in story:
        found = re.search(words, told.stdout[place:])
        assert found, f"{words!r} does not come (any more) after {told.stdout[max(0, place - 300) : place]!r}"
        place += found.end()
    for complaint in ("foreign", "missing", "makes no sense", "compressed message:", "not a message"):
        assert complaint not in told.stdout


def test_there_is_no_log_over_udp() -> None:
    done = run("demo", "--robot", "thesis", "--seconds", "1", "--link", "udp", "--log", "x.log")
    assert done.returncode == 2
    assert "--log writes the frames of a CAN bus" in done.stderr


def test_a_log_that_cannot_be_written_is_said(tmp_path: Path) -> None:
    done = run("demo", "--robot", "thesis", "--seconds", "1", "--json", "--log", str(tmp_path / "absent" / "x.log"))
    assert done.returncode == 2
    assert "cannot write the log" in done.stderr
