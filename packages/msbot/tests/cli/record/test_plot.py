"""`msbot plot`: what a person types, and what comes of it."""

from __future__ import annotations

import csv
import math
import re
from pathlib import Path

import pytest
from click.testing import CliRunner, Result

from msbot.cli.record import plot
from msbot.recording.recorder.batch import MEASURED, Kind, RecordedChannel, encode_object
from msbot_agent.link.can.protocol import parse_frame, wire_bits
from msbot_xrce.errors import MsbotError
from tests.lab.recorded import BEGAN_NS, NS, store

FRAME = "101#C010E803A3D81173"


@pytest.fixture
def file(tmp_path: Path) -> Path:
    """Ten seconds of a sine and of a beat."""
    items = [(int(Kind.CHANNEL), 1, 0, RecordedChannel(MEASURED, "json").encode())]
    for tenth in range(100):
        value = {"late_ms": 5 + 5 * math.sin(tenth / 10), "beats": {"knob": 1.0}}
        items.append((int(Kind.OBJECT), 1, BEGAN_NS + tenth * NS // 10, encode_object(value)))
    store(items, tmp_path / "a.mcap")
    return tmp_path / "a.mcap"


def run(*arguments: str | Path) -> Result:
    return CliRunner().invoke(plot.command, [str(one) for one in arguments], catch_exceptions=True)


def refusal(*arguments: str | Path) -> str:
    result = run(*arguments)
    assert isinstance(result.exception, MsbotError | SystemExit)
    assert result.exit_code != 0
    return result.output if isinstance(result.exception, SystemExit) else str(result.exception)


def test_without_a_curve_it_lists_those_there_are(file: Path) -> None:
    assert run(file).output.split() == ["@beat.knob", "@late"]


def test_curves_are_drawn_as_letters_with_their_figures(file: Path) -> None:
    pytest.importorskip("plotext")
    output = run(file, "@late", "@beat").output
    assert "@late [ms]" in output
    assert "@beat.knob [s]" in output
    row = next(line.split() for line in output.splitlines() if line.startswith(" ") and "@late  " in line)
    assert row[1] == "100"
    assert [float(cell) for cell in row[2:5]] == pytest.approx([5.9, 0.0, 10.0], abs=0.1)
    assert row[-1] == "ms"
    assert "\x1b" not in output


def test_a_table_has_every_value_of_the_piece(file: Path, tmp_path: Path) -> None:
    assert run(file, "@late", "--from", "2", "--to", "3", "--out", tmp_path / "a.csv").exit_code == 0
    head, *rows = csv.reader((tmp_path / "a.csv").read_text().splitlines())
    assert head == ["time_s", "curve", "value", "unit"]
    assert [float(row[0]) for row in rows] == pytest.approx([2 + n / 10 for n in range(11)], abs=1e-5)
    assert {(row[1], row[3]) for row in rows} == {("@late", "ms")}
    assert "is there already" in refusal(file, "@late", "--out", tmp_path / "a.csv")


@pytest.mark.parametrize("form", ["png", "svg"])
def test_pictures_are_pictures(file: Path, tmp_path: Path, form: str) -> None:
    pytest.importorskip("matplotlib")
    target = tmp_path / f"a.{form}"
    assert run(file, "@late", "@beat.knob", "--out", target).exit_code == 0
    content = target.read_bytes()
    assert content.startswith(b"\x89PNG") if form == "png" else b"</svg>" in content
    assert len(content) > 5000


def test_what_is_wrong_is_said(file: Path, tmp_path: Path) -> None:
    assert "did you mean @late?" in refusal(file, "@lat")
    assert "has no value in that time" in refusal(file, "@late", "--from", "50")
    assert "choose" in refusal(file, "@late", "--out", "a.gif") or ".png" in refusal(file, "@late", "--out", "a.gif")
    assert "say which curves" in refusal(file, "--out", tmp_path / "a.png")
    assert "use --from and --to for a file" in refusal(file, "@late", "--seconds", "3")
    assert "name the file" in refusal("@late", "--from", "3")
    assert "cannot read" in refusal(tmp_path / "none.mcap", "@late")
    (tmp_path / "odd.mcap").write_text("no")
    assert "is no recording" in refusal(tmp_path / "odd.mcap", "@late")


def test_a_frame_is_drawn_bit_by_bit() -> None:
    lines = run("--frame", FRAME).output.splitlines()
    bits = wire_bits(parse_frame(FRAME))
    drawn = "".join(line[7:] for line in lines if line.startswith("bits"))
    assert drawn == "".join(str(bit.level) for bit in bits)
    high = "".join(line[7:] for line in lines if line.startswith("CAN-H"))
    assert high == "".join("─" if bit.level else "▀" for bit in bits)
    assert sum(line.count("^") for line in lines) == sum(bit.stuff for bit in bits)


@pytest.mark.parametrize("text", [FRAME, "12345678#00", "123##1" + "00" * 64, "123#R4", "001#"])
def test_any_frame_becomes_a_picture_with_all_its_bits(tmp_path: Path, text: str) -> None:
    assert run("--frame", text, "--out", tmp_path / "a.svg").exit_code == 0
    drawn = re.findall(r'<text [^>]*class="(bit[^"]*)">([01])<', (tmp_path / "a.svg").read_text())
    bits = wire_bits(parse_frame(text))
    assert [(int(level), "stuff-text" in look) for look, level in drawn] == [(bit.level, bit.stuff) for bit in bits]


def test_a_frame_that_is_none_is_refused(tmp_path: Path) -> None:
    assert "--frame" in refusal("--frame", "hello")
    assert ".svg" in refusal("--frame", FRAME, "--out", tmp_path / "a.png")
    assert "is drawn alone" in refusal("--frame", FRAME, "@late")


def test_a_damaged_recording_is_drawn_as_far_as_it_goes_and_told_as_every_command_tells_it(file: Path) -> None:
    whole = file.read_bytes()
    file.write_bytes(whole[:-40])
    result = run(file, "@late", "--out", file.with_name("a.csv"))
    assert result.exit_code == 1
    assert re.search(r"^msbot: a\.mcap is damaged: .*what came before was read$", result.stderr, re.MULTILINE)
    assert result.stdout == f"{file.with_name('a.csv')}: 1 curve, 100 values\n"
    assert run(file).exit_code == 1


def test_an_ending_in_capitals_is_one(file: Path) -> None:
    assert run(file.rename(file.with_name("A.MCAP"))).output.split() == ["@beat.knob", "@late"]


def test_topics_that_nobody_can_read_are_named_with_their_count(tmp_path: Path) -> None:
    ours = (("slot", "AA"), ("port", "out"), ("topic", "odd"), ("type", "Odd"))
    items = [
        (int(Kind.CHANNEL), 1, 0, RecordedChannel(MEASURED, "json").encode()),
        (int(Kind.OBJECT), 1, BEGAN_NS, encode_object({"late_ms": 1.0})),
        (int(Kind.CHANNEL), 2, 0, RecordedChannel("/odd", "cdr", metadata=ours).encode()),
        *((int(Kind.SAMPLE), 2, BEGAN_NS + number, b"1234") for number in range(4)),
    ]
    store(items, tmp_path / "a.mcap")
    done = run(tmp_path / "a.mcap")
    assert done.stdout.split() == ["@late"]
    assert done.stderr == "left out, since the recording does not tell what the samples mean: /odd (4)\n"
