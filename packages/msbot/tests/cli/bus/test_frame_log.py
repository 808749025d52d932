"""Logs of frames: written as candump does, read from candump and from python-can's formats."""

from __future__ import annotations

import contextlib
import io
import logging
import os
import sys
from datetime import UTC, datetime
from pathlib import Path

import pytest

import can
from msbot.cli.bus import frame_log
from msbot.cli.bus.bus_commands import decode_log
from msbot.cli.bus.frame_log import FrameLog, FrameReader
from msbot.cli.bus.frame_words import WordsFormat
from msbot.pnp import FrameListener
from msbot_agent.link.can.adapters.python_can import frame_of
from msbot_agent.link.can.protocol import Frame, format_frame
from msbot_agent.link.can.protocol.notation import LogLine, parse_frame
from msbot_xrce.errors import ConfigError

FRAMES = ["123#DEADBEEF", "1ABCDEF0#1122", "123##1112233", "123##2112233", "7FF#R4", "20000004#0008000000000000"]


def test_what_is_written_is_read_again(tmp_path: Path) -> None:
    stream = io.StringIO()
    log = FrameLog(stream, "sim0", epoch_s=1_700_000_000.0)
    for number, text in enumerate(FRAMES):
        log.tap(number * 0.25, "AA", parse_frame(text))
    assert stream.getvalue().splitlines()[0] == "(1700000000.000000) sim0 123#DEADBEEF"
    path = tmp_path / "bus.log"
    path.write_text(stream.getvalue())
    reader = FrameReader()
    assert list(reader.read(str(path))) == [
        LogLine(1_700_000_000 + number * 0.25, "sim0", parse_frame(text)) for number, text in enumerate(FRAMES)
    ]
    assert (reader.frames, reader.unreadable) == (len(FRAMES), 0)


def test_lines_that_are_no_frames_are_counted(tmp_path: Path) -> None:
    path = tmp_path / "bus.log"
    path.write_bytes(b"(1.0) can0 123#11\n\nwhat?\n(2.0) can0 12\n\xff\xfe\n(3.0) can0 123#22\n")
    reader = FrameReader()
    assert [line.frame.data for line in reader.read(str(path))] == [b"\x11", b"\x22"]
    assert reader.unreadable == 3
    assert reader.first_problem.startswith("line 3: 'what?' is not a line of candump")


def test_a_file_without_a_frame_is_a_mistake(tmp_path: Path) -> None:
    path = tmp_path / "poem.txt"
    path.write_text("roses are red\n")
    with pytest.raises(ConfigError, match=r"there is no frame in .*poem.txt: line 1: 'roses are red' is not a line of"):
        list(FrameReader().read(str(path)))


@pytest.mark.parametrize("name", ["bus.log", "bus.asc", "bus.trc", "bus.csv"])
def test_a_line_without_an_end_is_no_log_and_is_not_kept(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(frame_log, "LONGEST_SKIPPED", 10_000)
    path = tmp_path / name
    path.write_text("x" * 20_000)
    with pytest.raises(ConfigError, match=r"is no log of frames: line 1 is longer than 10,000 characters; that of a"):
        list(FrameReader().read(str(path)))


@pytest.mark.skipif(not os.path.exists("/dev/zero"), reason="there is no /dev/zero here")
def test_a_device_without_an_end_is_not_read_to_the_end() -> None:
    with pytest.raises(ConfigError, match=r"^/dev/zero is no log of frames: line 1 is longer than 1,000,000 char"):
        list(FrameReader().read("/dev/zero"))


def test_lines_without_an_end_that_are_no_frames_are_no_log(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(frame_log, "MOST_WITHOUT", 3)
    path = tmp_path / "poem.txt"
    path.write_text("rose\n" * 4)
    reader = FrameReader()
    with pytest.raises(ConfigError, match=r"^there is no frame in .*poem.txt: line 1: 'rose' is not a line of"):
        list(reader.read(str(path)))
    assert reader.unreadable == 3
    path.write_text("(1.0) can0 123#11\n" + "rose\n" * 4)
    assert len(list(FrameReader().read(str(path)))) == 1, "one frame, and it is a log"


def test_a_long_line_is_told_in_short(tmp_path: Path) -> None:
    path = tmp_path / "bus.log"
    path.write_text("x" * 3000)
    with pytest.raises(ConfigError) as refused:
        list(FrameReader().read(str(path)))
    assert f"line 1: '{'x' * 100}...' is not a line of candump" in str(refused.value)


def test_that_a_file_is_empty_is_told(tmp_path: Path) -> None:
    path = tmp_path / "empty.log"
    path.touch()
    said: list[str] = []
    decode_log(str(path), FrameListener(), WordsFormat.BOTH, print, said.append)
    assert said == [f"there is no frame in {path}: it is empty"]


def test_an_empty_file_has_no_frames(tmp_path: Path) -> None:
    (tmp_path / "empty.log").touch()
    assert list(FrameReader().read(str(tmp_path / "empty.log"))) == []


@pytest.mark.parametrize("name", ["absent.log", "absent.asc", "absent.blf", "."])
def test_what_cannot_be_opened_is_said(name: str, tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="cannot read"):
        list(FrameReader().read(str(tmp_path / name)))


@pytest.mark.parametrize("ending", ["asc", "blf"])
def test_the_formats_of_python_can_are_read(ending: str, tmp_path: Path) -> None:
    path = tmp_path / f"bus.{ending}"
    texts = ["123#DEADBEEF", "1ABCDEF0#1122", "123##1112233", "7FF#R4"]
    with can.Logger(path) as logger:
        for number, text in enumerate(texts):
            logger(message_of(parse_frame(text), 1_700_000_000 + number * 0.25))
    lines = list(FrameReader().read(str(path)))
    assert [line.frame for line in lines] == [parse_frame(text) for text in texts]
    times = [line.at or 0 for line in lines]
    assert [round(at - times[0], 3) for at in times] == [0, 0.25, 0.5, 0.75]


@pytest.mark.parametrize("ending", ["asc", "blf", "trc"])
@pytest.mark.parametrize("content", [b"\xff\xfenonsense" * 40, b"", b"LOGG" + bytes(300), b"base hex\n 1 2 3 4"])
def test_a_broken_file_of_these_has_no_frames_or_is_said_to_be_broken(
    ending: str, content: bytes, tmp_path: Path
) -> None:
    path = tmp_path / f"bus.{ending}"
    path.write_bytes(content)
    found: list[LogLine] = []
    with contextlib.suppress(ConfigError):
        found = list(FrameReader().read(str(path)))
    assert found == []


def test_what_is_no_blf_file_is_said(tmp_path: Path) -> None:
    path = tmp_path / "bus.blf"
    path.write_bytes(b"nonsense" * 40)
    with pytest.raises(ConfigError, match=r"is no \.blf file that python-can understands"):
        list(FrameReader().read(str(path)))


def test_without_python_can_the_remedy_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "can", None)
    with pytest.raises(
        ConfigError, match=r"reading .blf files needs python-can: install it with `pip install 'msbot\["
    ):
        list(FrameReader().read(str(tmp_path / "bus.blf")))


@pytest.mark.parametrize("text", FRAMES)
def test_messages_of_python_can_become_frames(text: str) -> None:
    frame = parse_frame(text)
    assert frame_of(message_of(frame, 0.0)) == frame


def message_of(frame: Frame, at: float) -> can.Message:
    return can.Message(
        timestamp=at,
        arbitration_id=frame.can_id,
        is_extended_id=frame.extended,
        is_remote_frame=frame.remote,
        is_error_frame=frame.error,
        dlc=frame.remote_length if frame.remote else len(frame.data),
        data=None if frame.remote else frame.data,
        is_fd=frame.fd,
        bitrate_switch=frame.brs,
        error_state_indicator=frame.esi,
        channel=0,
    )


def test_a_table_of_gvret_is_read(tmp_path: Path) -> None:
    file = tmp_path / "car.csv"
    file.write_text(
        "Time Stamp,ID,Extended,Dir,Bus,LEN,D1,D2,D3,D4,D5,D6,D7,D8\n"
        "166064000,0000021A,false,Rx,0,3,FE,36,12,\n"
        "166065500,1ABCDEF0,true,Tx,1,1,A5\n"
        "166066000,0000021A,false,0,2,01,02,\n"  # of older programs, without a direction
        "166067000,0000021A,false,Rx,0,3,FE,36,\n"
        "166068000,0000FFFF,false,Rx,0,0\n"
    )
    reader = FrameReader()
    assert list(reader.read(str(file))) == [
        LogLine(166.064, "can0", parse_frame("21A#FE3612")),
        LogLine(166.0655, "can1", parse_frame("1ABCDEF0#A5")),
        LogLine(166.066, "can0", parse_frame("21A#0102")),
    ]
    assert reader.unreadable == 2
    assert reader.first_problem == (
        "line 5: '166067000,0000021A,false,Rx,0,3,FE,36,' says it has 3 data bytes and shows 2"
    )


def test_a_table_of_gvret_without_a_frame_is_a_mistake(tmp_path: Path) -> None:
    (tmp_path / "car.csv").write_text("Time Stamp,ID,Extended,Bus,LEN\n1,x,false,0,0\n")
    with pytest.raises(ConfigError, match=r"there is no frame in .*: line 2: invalid literal"):
        list(FrameReader().read(str(tmp_path / "car.csv")))


ASC = """date {day} {month} 7 09:08:07.000 2026
base {base}  timestamps relative
no internal events logged
Begin Triggerblock {day} {month} 7 09:08:07.000 2026
   0.000000 Start of measurement
   0.010000 1  {short}             Rx   d 3 {three}
   0.010000 1  {long}x       Rx   d 2 {two}  Length = 100000 BitCount = 100 ID = {long}x
End TriggerBlock
"""
DECIMAL = {"base": "dec", "short": "201", "three": "17 34 51", "long": "448576240", "two": "255 1"}
HEXADECIMAL = {"base": "hex", "short": "C9", "three": "11 22 33", "long": "1ABCBAF0", "two": "FF 01"}


@pytest.mark.parametrize("numbers", [DECIMAL, HEXADECIMAL], ids=["dec", "hex"])
@pytest.mark.parametrize(
    ("day", "month"), [("Tue", "Apr"), ("Di", "Apr"), ("Sa", "Mär"), ("Do", "Mai"), ("Mi", "Okt"), ("Mo", "Dez")]
)
def test_asc_files_of_a_german_windows_and_with_decimal_numbers_are_read(
    tmp_path: Path, numbers: dict[str, str], day: str, month: str
) -> None:
    path = tmp_path / "a.asc"
    path.write_text(ASC.format(day=day, month=month, **numbers), encoding="utf-8")
    reader = FrameReader()
    lines = list(reader.read(str(path)))
    assert [format_frame(line.frame) for line in lines] == ["0C9#112233", "1ABCBAF0#FF01"]
    which = {"Apr": 4, "Mär": 3, "Mai": 5, "Okt": 10, "Dez": 12}[month]
    assert [line.at for line in lines] == [datetime(2026, which, 7, 9, 8, 7, 10_000).timestamp()] * 2
    assert (reader.unreadable, reader.doubts) == (0, 0)


TRC_2_1 = """;$FILEVERSION=2.1
;$STARTTIME=46090.5
;$COLUMNS=N,O,T,B,I,d,L,D
      1         0.000 DT 1     0201 Rx 4    0A 0B 0C 0D
      2         0.400 DT 2 1ABCDEF0 Tx 2    5A A5
      3         0.900 ER 1        - Rx 5    04 00 02 00 00
      4         1.400 ST 1        - Rx 4    00 00 00 08
      5         1.900 FD 1     0301 Rx 9    01 02 03 04 05 06 07 08 09 0A 0B 0C
      6         2.400 EC 1        - Rx 2    00 60
      7         2.900 RR 1     0301 Rx 8
"""
TRC_1_1 = """;$FILEVERSION=1.1
;$STARTTIME=46090.5
;   Start time: 09.03.2026 12:00:00.000.0
     1)         0.0  Rx         0201  4  0A 0B 0C 0D
     2)         0.4  Tx     1ABCDEF0  2  5A A5
     3)         0.9  Warng  FFFFFFFF  4  00 00 00 08  BUSLIGHT
     4)         2.9  Rx         0301  8  RTR
"""


@pytest.mark.parametrize(
    ("text", "frames"),
    [
        (TRC_2_1, ["201#0A0B0C0D", "1ABCDEF0#5AA5", "301##00102030405060708090A0B0C", "301#R8"]),
        (TRC_1_1, ["201#0A0B0C0D", "1ABCDEF0#5AA5", "301#R8"]),
    ],
    ids=["2.1", "1.1"],
)
def test_traces_of_pcan_are_read_with_events_that_are_no_frames_between(
    tmp_path: Path, text: str, frames: list[str]
) -> None:
    path = tmp_path / "a.trc"
    path.write_text(text)
    reader = FrameReader()
    lines = list(reader.read(str(path)))
    assert [format_frame(line.frame) for line in lines] == frames
    began = datetime(2026, 3, 9, 12, tzinfo=UTC).timestamp()
    assert [round((line.at or 0) - began, 4) for line in lines[:2]] == [0, 0.0004]
    assert (reader.unreadable, reader.doubts) == (0, 0)


@pytest.mark.parametrize(
    ("name", "text", "words"),
    [
        (
            "a.trc",
            TRC_2_1 + "      8         3.000 DT 1\n",
            "TRCReader: Failed to parse message '8         3.000 DT 1'",
        ),
        (
            "a.asc",
            ASC.format(day="Tue", month="Apr", **HEXADECIMAL)
            + "   0.02 CANFD   1 Rx        201                    1 0 9  10 01 02 03 04 05 06 07 08 09 0a\n",
            "DLC vs Data Length mismatch",
        ),
    ],
)
def test_what_a_library_warns_of_is_told_in_our_sentence_and_nowhere_else(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], name: str, text: str, words: str
) -> None:
    path = tmp_path / name
    path.write_text(text)
    reader, told = FrameReader(), list[str]()
    assert len(list(reader.read(str(path)))) >= 2
    reader.tell("a log", told.append)
    assert len(told) == 1
    assert told[0].startswith("python-can warns of 1 line of a log; ")
    assert words in told[0]
    assert capsys.readouterr() == ("", "")
    assert logging.getLogger("can").propagate
    assert logging.getLogger("can").handlers == []


ODD_CANDUMP = r"""
 (2026-09-01 10:11:12.123456)  can0  123   [8]  11 22 33 44 55 66 77 88
 (000.012345)  can0  123   [8]  11 22 33 44 55 66 77 88
  can0  RX - -  123   [8]  11 22 33 44 55 66 77 88
  can0  RX B -  123  [12]  11 22 33 44 55 66 77 88 99 AA BB CC
 (1700000000.000001)  can0  TX - -  123   [8]  11 22 33 44 55 66 77 88
  can0  123   [8]  11 22 33 44 55 66 77 88   '."3DUfw.'
  can0  123   [8]  88.77.66.55.44.33.22.11
  can0  123   [8]  00010001 00100010 00110011 01000100 01010101 01100110 01110111 10001000
  vcan0  20000004   [8]  00 04 00 00 00 00 00 00   ERRORFRAME
	controller-problem{rx-error-warning}
  can0  314   [8]  remote request
  can0  314   [0]
(1700000000.123456) can0 123#11223344 R
(1700000000.123456) can0 123#11223344 T
(1700000000.123456) can0 123##1112233445566778899AABBCC
(1700000000.123456) can0 123#R8
(1700000000.123456) can0 123#1122334455667788_9
(1700000000.123456) can0 123#11.22.33.44
(1700000000.123456) can0 20000080#0000000000000000
(1700000000.123456) slcan0 1F334455#1122334455667788
"""


def test_every_form_of_candump_is_read_or_its_line_counted(tmp_path: Path) -> None:
    path = tmp_path / "odd.txt"
    path.write_text(ODD_CANDUMP)
    reader = FrameReader()
    eight = "123#1122334455667788"
    assert [format_frame(line.frame) for line in reader.read(str(path))] == [
        *(eight, eight, eight, "123##1112233445566778899AABBCC", eight, eight),
        *("20000004#0004000000000000", "314#R8", "314#"),
        *("123#11223344", "123#11223344", "123##1112233445566778899AABBCC", "123#R8", f"{eight}_9", "123#11223344"),
        *("20000080#0000000000000000", "1F334455#1122334455667788"),
    ]
    assert reader.unreadable == 3  # octets backwards, octets as bits, and what candump says of an error report
    assert reader.first_problem.startswith(
        "line 8: 'can0  123   [8]  88.77.66.55.44.33.22.11' is not a line of candump"
    )
