"""`msbot bus cost`: bits of frames, as JSON and as a table."""

from __future__ import annotations

import json

import pytest
from click.testing import CliRunner
from hypothesis import given

from msbot.cli.bus.bus_commands import command
from msbot.cli.bus.load import cost_json, costs
from msbot_agent.cli import main
from msbot_agent.link.can.protocol.bits import wire_bits
from msbot_agent.link.can.protocol.frames import Frame
from msbot_agent.link.can.protocol.notation import format_frame
from tests.link.can.protocol.test_bits import frames
from tests.link.wire_receiver import Receiver


def said(*arguments: str) -> str:
    result = CliRunner().invoke(command, arguments)
    assert result.exit_code == 0, result.output
    return result.output


def test_json_lists_the_frames_in_their_order_as_they_were_written() -> None:
    texts = ["123#de.ad.be.ef", "1ABCDEF0#1122", "123##1112233445566778899", "555#R4"]
    listed = json.loads(said("cost", "--json", *texts))
    assert [entry["frame"] for entry in listed] == texts
    assert [set(entry) for entry in listed] == [{"frame", "nominal_bits", "data_bits"}] * 4
    assert [(entry["nominal_bits"], entry["data_bits"]) for entry in listed] == [(81, 0), (86, 0), (29, 129), (47, 0)]


@given(frames())
def test_bits_are_those_a_receiver_counts(frame: Frame) -> None:
    received = Receiver([bit.level for bit in wire_bits(frame)]).receive()
    text = format_frame(frame)
    assert json.loads(cost_json([text])) == [
        {"frame": text, "nominal_bits": received.nominal_bits, "data_bits": received.data_bits}
    ]
    assert costs([text])[0].stuff_bits() == received.stuff_bits


def test_the_phases_of_fd_are_told_apart_with_and_without_a_bit_rate_switch() -> None:
    """34 zeros of a header stuffed: 0 00000000000 0 0 1 0 B is SOF to BRS, E 0000 the start of the data phase."""
    without, with_switch = json.loads(said("cost", "--json", "000##0", "000##1"))
    # After RES: BRS, ESI and DLC are 0 as well, so five equal bits end at the third bit of the DLC.
    assert (without["nominal_bits"], without["data_bits"]) == (17 + 2 + 12, 5 + 1 + 27 + 1)
    assert (with_switch["nominal_bits"], with_switch["data_bits"]) == (17 + 2 + 12, 5 + 27 + 1)


def test_the_table_has_times_and_a_sum() -> None:
    lines = said(
        "cost", "--bitrate", "500000", "--data-bitrate", "2000000", "123#DEADBEEF", "123##1112233"
    ).splitlines()
    assert [word.strip() for word in lines[0].split("  ") if word] == [
        "frame",
        "nominal bits",
        "data bits",
        "of these stuffed",
        "µs on the wire",
    ]
    assert lines[1].split() == ["123#DEADBEEF", "81", "0", "2", "162.00"]
    nominal, data = (int(cell) for cell in lines[2].split()[1:3])
    assert float(lines[2].split()[4]) == pytest.approx(nominal * 2 + data * 0.5)
    assert lines[3].split()[:3] == ["together", str(81 + nominal), str(data)]


def test_without_a_switch_all_bits_take_the_nominal_rate() -> None:
    lines = said("cost", "--bitrate", "500000", "--data-bitrate", "2000000", "123##0112233").splitlines()
    assert len(lines) == 2, "one frame needs no sum"
    nominal, data = (int(cell) for cell in lines[1].split()[1:3])
    assert float(lines[1].split()[4]) == pytest.approx((nominal + data) * 2)


def test_data_is_padded_with_cc() -> None:
    listed = json.loads(said("cost", "--json", "123##1112233445566778899", "123##1112233445566778899CCCCCC"))
    assert listed[0]["data_bits"] == listed[1]["data_bits"]


@pytest.mark.parametrize("arguments", [("123#DEADBEEF", "hello"), ("20000004#0008",)])
def test_a_mistake_is_one_sentence_and_status_2(
    arguments: tuple[str, ...], monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("sys.argv", ["msbot", "bus", "cost", "--json", *arguments])
    with pytest.raises(SystemExit) as caught:
        main()
    assert caught.value.code == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert err.count("\n") == 1
    assert err.startswith("msbot: ")
