"""`msbot log` of recordings that are cut short, foreign or newer, and of targets that cannot be written."""

from __future__ import annotations

from collections import Counter
from pathlib import Path

import pytest
from click.testing import CliRunner, Result

from msbot.cli.record import log
from msbot.cli.record.log import _channel
from msbot.recording.recorder.batch import Kind, RecordedChannel, encode_object
from msbot.recording.recorder.schemas import ENCODING, FRAME_DEFINITION, FRAME_TYPE, frame_octets
from msbot.recording.recordings.summary import named_topics
from msbot_agent.link.can.protocol import parse_frame
from msbot_xrce.errors import MsbotError
from tests.lab.recorded import BEGAN_NS, NS, store

MAGIC = b"\x89MCAP0\r\n"


@pytest.fixture
def file(tmp_path: Path) -> Path:
    """Two thousand messages in several chunks."""
    items = [(int(Kind.CHANNEL), 1, 0, RecordedChannel("/t", "json").encode())]
    for number in range(2000):
        value = encode_object({"n": number, "words": f"{number} " * 40})
        items.append((int(Kind.OBJECT), 1, BEGAN_NS + number * NS // 100, value))
    store(items, tmp_path / "a.mcap")
    return tmp_path / "a.mcap"


def run(*arguments: str | Path) -> Result:
    return CliRunner().invoke(log.command, [str(one) for one in arguments])


def refusal(*arguments: str | Path) -> str:
    result = run(*arguments)
    assert isinstance(result.exception, MsbotError)
    return str(result.exception)


def test_a_whole_recording_ends_with_status_0(file: Path, tmp_path: Path) -> None:
    assert run("show", file).exit_code == 0
    assert run("filter", file, tmp_path / "b.mcap").exit_code == 0
    assert run("diff", file, tmp_path / "b.mcap").exit_code == 0
    assert run("export", file, tmp_path / "a.log").exit_code == 0


def test_one_that_was_cut_is_read_as_far_as_it_goes_and_scripts_are_told(file: Path, tmp_path: Path) -> None:
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(file.read_bytes()[: file.stat().st_size // 2])
    shown = run("show", cut)
    assert shown.exit_code == 1
    assert 100 < len(shown.stdout.splitlines()) < 2000
    assert "cut.mcap is damaged" in shown.stderr
    for arguments in (("filter", cut, tmp_path / "b.mcap"), ("export", cut, tmp_path / "b.csv"), ("diff", cut, cut)):
        result = run(*arguments)
        assert result.exit_code == 1
        assert "what came before was read" in result.stderr
    assert run("show", tmp_path / "b.mcap").stdout.count("\n") == shown.stdout.count("\n")
    assert (tmp_path / "b.csv").exists()


def test_what_is_no_recording_leaves_no_file_behind(tmp_path: Path) -> None:
    newer, foreign, target = tmp_path / "newer.mcap", tmp_path / "foreign.mcap", tmp_path / "b"
    newer.write_bytes(MAGIC.replace(b"0", b"1") + bytes(100))
    foreign.write_bytes(b"SQLite format 3\0" + bytes(100))
    for source, words in (
        (newer, "of version 1; this program reads version 0"),
        (foreign, "is no recording"),
        (tmp_path / "none.mcap", "cannot read"),
    ):
        assert words in refusal("show", source)
        assert words in refusal("filter", source, target.with_suffix(".mcap"))
        assert words in refusal("export", source, target.with_suffix(".csv"))
        assert words in refusal("export", source, target.with_suffix(".log"))
    assert sorted(tmp_path.iterdir()) == [foreign, newer]


def test_an_ending_that_names_no_format_is_told_all_there_are(file: Path, tmp_path: Path) -> None:
    words = refusal("export", file, tmp_path / "a.xlsx")
    for ending in (".csv", ".parquet", ".log", ".asc", ".blf"):
        assert words.count(ending) == 1
    assert not (tmp_path / "a.xlsx").exists()


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="needs the device that is always full")
def test_a_full_disk_is_one_sentence(file: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The device stands for the new file: what is written to it meets no space."""
    monkeypatch.setattr(Path, "exists", lambda _: False)
    monkeypatch.setattr(Path, "unlink", lambda _, missing_ok: None)
    (tmp_path / "full.csv").symlink_to("/dev/full")
    assert "No space left" in refusal("export", file, tmp_path / "full.csv")


@pytest.mark.parametrize(
    ("link", "channel"),
    [
        ("can:can0", "can0"),
        ("can:vcan7?fd=1", "vcan7"),
        ("canfd:can1", "can1"),
        ("can-legacy:can0", "can0"),
        ("sim:500000", "sim500000"),
        ("sim:class 7B", "simclass7B"),
        ("can:", "can"),
    ],
)
def test_frames_are_written_with_the_name_of_their_interface(link: str, channel: str) -> None:
    assert _channel(link) == channel


def test_topics_that_nobody_can_read_are_named_with_their_count(tmp_path: Path) -> None:
    items = [
        (int(Kind.CHANNEL), 1, 0, RecordedChannel("/known", "json").encode()),
        (int(Kind.CHANNEL), 2, 0, RecordedChannel("/strange", "json").encode()),
        (int(Kind.OBJECT), 1, BEGAN_NS, encode_object({"n": 1})),
        *((int(Kind.OBJECT), 2, BEGAN_NS + number, b"\xff no JSON") for number in range(3)),
    ]
    store(items, tmp_path / "a.mcap")
    told = "left out, since the recording does not tell what the samples mean: /strange (3)\n"
    shown = run("show", tmp_path / "a.mcap")
    assert (shown.exit_code, shown.stderr, shown.stdout.count("\n")) == (0, told, 1)
    exported = run("export", tmp_path / "a.mcap", tmp_path / "a.csv")
    assert (exported.exit_code, exported.stderr) == (0, told)
    assert (
        run("show", tmp_path / "a.mcap", "--topic", "/strange").stdout.count("whose meaning the recording does not")
        == 3
    )
    pytest.importorskip("pyarrow")
    exported = run("export", tmp_path / "a.mcap", tmp_path / "a.parquet")
    assert (exported.exit_code, exported.stderr) == (0, told)
    filtered = run("filter", tmp_path / "a.mcap", tmp_path / "b.mcap", "--ros2")
    assert "left out, for they are no ROS 2 messages: /strange (3), /known (1)\n" in filtered.stdout


def test_of_many_topics_the_first_are_named_and_the_others_counted() -> None:
    counts = Counter({f"/t{number:02}\x1b": 100 - number for number in range(23)})
    named = named_topics(counts)
    assert named.startswith("/t00? (100), /t01? (99), ")
    assert named.endswith(" and 3 other topics")


def test_frames_that_are_none_are_counted(tmp_path: Path) -> None:
    bus = RecordedChannel("/msbot/frames/can:can0", "cdr", FRAME_TYPE, ENCODING, FRAME_DEFINITION)
    items = [
        (int(Kind.CHANNEL), 1, 0, bus.encode()),
        (int(Kind.SAMPLE), 1, BEGAN_NS, frame_octets(parse_frame("123#11"), is_sent=True)),
        (int(Kind.SAMPLE), 1, BEGAN_NS, b"short"),
        (int(Kind.SAMPLE), 1, BEGAN_NS, frame_octets(parse_frame("123#1122"), is_sent=True)[:-1]),
    ]
    store(items, tmp_path / "a.mcap")
    exported = run("export", tmp_path / "a.mcap", tmp_path / "a.log")
    assert exported.stdout.endswith("1 frame\n")
    assert exported.stderr == "left out, for they are no frames: /msbot/frames/can:can0 (2)\n"
    assert "/msbot/frames/can:can0 (2)" in run("show", tmp_path / "a.mcap").stderr
