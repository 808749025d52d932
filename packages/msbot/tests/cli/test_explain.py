"""`msbot explain` and `msbot quiz`: messages, frames, captures; and the dissector in tshark on the same captures."""

from __future__ import annotations

import json
import os
import re
import shutil
import socket
import subprocess
from itertools import islice
from pathlib import Path
from random import Random

import pytest
from click.testing import CliRunner, Result

from msbot.cli.explain import command as explain
from msbot_agent.link.can.protocol import frame_bits, parse_frame
from msbot_agent.link.relay import relay_messages as relay
from msbot_school.cli.fault import quiz_command as quiz
from msbot_school.quiz import frame_question, questions, stuffed
from msbot_xrce import read_fields
from msbot_xrce.errors import ConfigError
from tests import ROOT

dpkt = pytest.importorskip("dpkt", reason="pip install 'msbot-agent[pcap]'")

VECTORS = ROOT / "tests" / "vectors"
CAPTURES = ("udp_reqrep_req", "udp_raw_keyed_session", "udp_ex_big_pub")
WRITE = "81010000 07010800 000a0015 0000803f"


def capture(name: str, file: Path) -> list[bytes]:
    """A capture of the genuine client and agent as a pcap file; returns its messages."""
    lines = [json.loads(line) for line in (VECTORS / f"{name}.jsonl").read_text().splitlines()]
    ends = {True: ("10.0.0.2", 40000), False: ("10.0.0.1", 8888)}
    with file.open("wb") as stream:
        writer = dpkt.pcap.Writer(stream)
        for line in lines:
            up = line["dir"] == "client>agent"
            (source, source_port), (target, target_port) = ends[up], ends[not up]
            udp = dpkt.udp.UDP(sport=source_port, dport=target_port, data=bytes.fromhex(line["hex"]))
            udp.ulen = len(udp)
            ip = dpkt.ip.IP(src=socket.inet_aton(source), dst=socket.inet_aton(target), p=17, data=udp)
            ip.len = len(ip)
            writer.writepkt(bytes(dpkt.ethernet.Ethernet(data=ip)), ts=line["t"])
    return [bytes.fromhex(line["hex"]) for line in lines]


def run(*words: str) -> Result:
    return CliRunner().invoke(explain, list(words))


def test_a_message_in_words_and_fields() -> None:
    done = run(*WRITE.split())
    assert done.exit_code == 0, done.output
    assert "WRITE_DATA to datawriter 0x0015, request 10: 4 bytes 00 00 80 3f" in done.output
    assert "     10  0015                      WRITE_DATA.object_id          0x0015" in done.output
    (told,) = json.loads(run(WRITE, "--json").output)
    assert [field["name"] for field in told["fields"]][-3:] == ["request_id", "object_id", "payload"]


def test_a_frame_down_to_its_bits_and_what_they_cost() -> None:
    done = run("103#C181000A")
    assert "node 3 to master" in done.output
    assert "  ID              00100000(1)011" in done.output
    bits = frame_bits(parse_frame("103#C181000A")).nominal_bits
    assert f"{bits} bits with the pause after it, 5 of them stuffed: {bits * 8} µs at 125 kbit/s" in done.output


def test_a_file_of_frames(tmp_path: Path) -> None:
    log = tmp_path / "bus.log"
    log.write_text("(1.5) can0 103#8181010000070108\n(1.6) can0 103#42000A00150000\nnonsense\n")
    done = run(str(log), "--json")
    first, second = json.loads(done.stdout)
    assert "1 of 3 lines were no frames; line 3: " in done.stderr
    assert first["words"] == ["node 3 to master, S  1"]
    assert "bits" not in second
    assert "cost" in json.loads(run(str(log), "--json", "--fields").stdout)[1]


@pytest.mark.parametrize(
    ("what", "right"),
    [
        ("tea", "'tea' is no file here, no frame such as 103#C181000A, and no message"),
        ("8101", "no message in hexadecimal of 4 bytes or more"),
        ("XYZ#11", "123#DEADBEEF"),
    ],
)
def test_what_is_none_of_them_is_one_sentence(what: str, right: str) -> None:
    done = run(what)
    assert isinstance(done.exception, ConfigError)
    assert right in str(done.exception)


def test_a_file_that_is_no_capture_is_one_sentence(tmp_path: Path) -> None:
    for content in (b"", b"no capture at all, but long enough to be one", bytes(64)):
        file = tmp_path / "x.pcap"
        file.write_bytes(content)
        done = run(str(file))
        assert isinstance(done.exception, ConfigError), content
        assert "is no capture that can be read" in str(done.exception)


def test_a_capture_that_breaks_off_is_told_up_to_there(tmp_path: Path) -> None:
    file = tmp_path / "x.pcap"
    capture("udp_reqrep_req", file)
    file.write_bytes(file.read_bytes()[:-20])
    done = run(str(file))
    assert "CREATE_CLIENT" in done.output
    assert done.exception is None or isinstance(done.exception, ConfigError | SystemExit)


def test_a_capture_of_a_network_in_words(tmp_path: Path) -> None:
    file = tmp_path / "session.pcap"
    messages = capture("udp_reqrep_req", file)
    told = json.loads(run(str(file), "--json", "--fields").output)
    assert len(told) == len(messages)
    assert told[0]["way"] == "10.0.0.2:40000 -> 10.0.0.1:8888"
    assert any("CREATE_CLIENT" in line for line in told[0]["words"])
    assert any("CREATE requester" in line for one in told for line in one["words"])


def test_what_is_no_xrce_in_a_capture_is_named_as_what_it_is(tmp_path: Path) -> None:
    file = tmp_path / "beside.pcap"
    rtps, mdns = b"RTPS\x02\x03\x01\x0f" + bytes(12) + b"\x09\x01\x08\0" + bytes(8), b"\0\0\x84\0\0\0\0\1" + bytes(20)
    with file.open("wb") as stream:
        writer = dpkt.pcap.Writer(stream)
        xrce = bytes.fromhex("80000000 00011000 58524345 0100010F AAAABBBB 81 00FC03")
        for octets, port in ((rtps, 7400), (mdns, 5353), (rtps, 8888), (xrce, 8888)):
            udp = dpkt.udp.UDP(sport=port, dport=port, data=octets, ulen=8 + len(octets))
            packet = dpkt.ip.IP(src=b"\x0a\0\0\2", dst=b"\x0a\0\0\1", p=17, data=udp, len=28 + len(octets))
            writer.writepkt(bytes(dpkt.ethernet.Ethernet(type=2048, data=packet)), ts=1.0)
    told = [one["words"] for one in json.loads(run(str(file), "--json", "--fields").output)]
    assert [words[0].split(",")[0] for words in told[:3]] == ["RTPS 2.3", "mDNS", "RTPS 2.3"]
    assert [len(words) for words in told[:3]] == [1, 1, 1]
    assert any("CREATE_CLIENT AAAABBBB" in line for line in told[3])


def test_what_a_relay_carries_is_unpacked(tmp_path: Path) -> None:
    beat = bytes.fromhex("81010000070108000006000100000000")
    up, down = relay.encode(relay.Up(3, "node 3", beat)), relay.encode(relay.Down(3, 7, beat))
    hello = relay.encode(relay.Hello(bytes(8), "desk", "can:can0", 512, 500_000, True, False))
    inside = json.loads(run(beat.hex(), "--json").output)[0]["words"]
    told = [json.loads(run(octets.hex(), "--json").output)[0]["words"] for octets in (up, down, hello, b"\0\xffR\x63")]
    assert told == [
        ["relay: a packet from part 3 (node 3), 16 bytes", *inside],
        ["relay: packet 7 for part 3, 16 bytes", *inside],
        ["relay: HELLO, I am desk and carry the parts of can:can0"],
        ["relay: relay message of 4 bytes cannot be read: 99 is not a valid RelayKind"],
    ]
    file = tmp_path / "relay.pcap"
    with file.open("wb") as stream:
        udp = dpkt.udp.UDP(sport=40000, dport=8888, data=up, ulen=8 + len(up))
        packet = dpkt.ip.IP(src=b"\x0a\0\0\2", dst=b"\x0a\0\0\1", p=17, data=udp, len=28 + len(up))
        dpkt.pcap.Writer(stream).writepkt(bytes(dpkt.ethernet.Ethernet(type=2048, data=packet)), ts=1.0)
    (one,) = json.loads(run(str(file), "--json", "--fields").output)
    assert (one["words"][0], bool(one["fields"])) == ("relay: a packet from part 3 (node 3), 16 bytes", True)


def test_a_capture_of_a_can_bus(tmp_path: Path) -> None:
    file = tmp_path / "can.pcap"
    octets = (0x103).to_bytes(4, "big") + bytes((4, 0, 0, 0)) + bytes.fromhex("C181000A") + bytes(4)
    with file.open("wb") as stream:
        dpkt.pcap.Writer(stream, linktype=227).writepkt(octets, ts=2.0)
    (told,) = json.loads(run(str(file), "--json").output)
    assert told["frame"] == "103#C181000A"
    assert told["words"][0].startswith("node 3 to master")


@pytest.mark.skipif(
    shutil.which("tshark") is None and not os.environ.get("MSBOT_NEED_TSHARK"), reason="apt install tshark"
)
@pytest.mark.parametrize("name", CAPTURES)
def test_wireshark_reads_the_same_fields(name: str, tmp_path: Path) -> None:
    file, lua = tmp_path / "session.pcap", tmp_path / "xrce.lua"
    messages = capture(name, file)
    assert run("--wireshark", str(lua)).exit_code == 0
    names = ("submessage_id", "request_id", "object_id", "client_key", "status", "first_unacked", "bitmap", "last")
    asked = [word for field in names for word in ("-e", f"xrce.{field}")]
    done = subprocess.run(
        ["tshark", "-X", f"lua_script:{lua}", "-r", str(file), "-T", "fields", "-E", "separator=;", *asked],
        capture_output=True,
        text=True,
        timeout=60,
        check=True,
    )
    assert "Lua: Error" not in done.stderr + done.stdout
    rows = done.stdout.splitlines()
    assert len(rows) == len(messages)
    compared = 0
    for row, message in zip(rows, messages, strict=True):
        fields, fault = read_fields(message)
        if fault:
            continue
        for field, shown in zip(names, row.split(";"), strict=True):
            ours = [one.value for one in fields if one.name == field]
            assert [int(value, 0) for value in shown.split(",") if value] == ours, (field, message.hex())
            compared += len(ours)
    assert compared > 10


def beside(payloads: list[bytes], file: Path) -> None:
    """A capture of datagrams to an agent."""
    with file.open("wb") as stream:
        writer = dpkt.pcap.Writer(stream)
        for octets in payloads:
            udp = dpkt.udp.UDP(sport=40000, dport=8888, data=octets, ulen=8 + len(octets))
            packet = dpkt.ip.IP(src=b"\x0a\0\0\2", dst=b"\x0a\0\0\1", p=17, data=udp, len=28 + len(octets))
            writer.writepkt(bytes(dpkt.ethernet.Ethernet(type=2048, data=packet)), ts=1.0)


@pytest.mark.skipif(
    shutil.which("tshark") is None and not os.environ.get("MSBOT_NEED_TSHARK"), reason="apt install tshark"
)
def test_wireshark_reads_relays_and_names_requests_and_replies(tmp_path: Path) -> None:
    file, lua = tmp_path / "relay.pcap", tmp_path / "xrce.lua"
    request, heard = map(bytes.fromhex, ("8101000007010800000a001700000000", "81010000090108000006001800000000"))
    messages: list[relay.Message] = [
        relay.Hello(b"bootboot", "Tür", "can:can0", 512, 500_000, True, False),
        relay.Up(3, "node 3", request),
        relay.Up(4, "", request),
        relay.Down(3, 7, heard),
        relay.RelayBeat(9, 1, "smoke", (relay.Event(3, relay.RelayEventKind.BACK, "node 3"),)),
        relay.Room(((3, 7),)),
        relay.Welcome(b"bootboot", 0xABCD, 2),
        relay.Heard(9, 1, 2, 3),
        relay.Refused("another relay of that name"),
        relay.Who(),
        relay.Bye(),
    ]
    cut = [relay.encode(messages[0])[:14], relay.encode(messages[0])[:-3], b"\0\xffRc", b"\0\xffR"]
    beside([*map(relay.encode, messages), *cut, request], file)
    assert run("--wireshark", str(lua)).exit_code == 0
    names = ("relay_name", "relay_part", "relay_words", "relay_count", "relay_stops", "submessage_id", "service")
    asked = [word for field in ("_ws.col.Info", *(f"xrce.{name}" for name in names)) for word in ("-e", field)]
    done = subprocess.run(
        ["tshark", "-X", f"lua_script:{lua}", "-r", str(file), "-T", "fields", "-E", "separator=;", *asked],
        capture_output=True,
        text=True,
        timeout=60,
        check=True,
    )
    assert "Lua: Error" not in done.stderr + done.stdout
    assert [row.split(";") for row in done.stdout.splitlines()] == [
        ["relay HELLO", "Tür", "", "", "", "", "", ""],
        ["relay UP: WRITE_DATA (request)", "", "3", "node 3", "", "", "0x07", "request"],
        ["relay UP: WRITE_DATA (request)", "", "4", "", "", "", "0x07", "request"],
        ["relay DOWN: DATA (request)", "", "3", "", "7", "", "0x09", "request"],
        ["relay BEAT", "", "", "", "9", "", "", ""],
        ["relay ROOM", "", "", "", "", "", "", ""],
        ["relay WELCOME", "", "", "", "", "2", "", ""],
        ["relay HEARD", "", "", "", "9", "2", "", ""],
        ["relay REFUSED", "", "", "another relay of that name", "", "", "", ""],
        ["relay WHO", "", "", "", "", "", "", ""],
        ["relay BYE", "", "", "", "", "", "", ""],
        ["relay HELLO", "", "", "", "", "", "", ""],
        ["relay HELLO", "Tür", "", "", "", "", "", ""],
        ["relay 0x63", "", "", "", "", "", "", ""],
        ["40000 → 8888 Len=3", "", "", "", "", "", "", ""],
        ["WRITE_DATA (request)", "", "", "", "", "", "0x07", "request"],
    ]


def test_questions_are_the_same_for_the_same_seed_and_their_answers_are_right() -> None:
    first, again = (list(islice(questions(7), 80)) for _ in range(2))
    assert first == again
    assert first != list(islice(questions(8), 80))
    assert len({question.text for question in first}) > 10
    for question in first:
        assert question.is_right(f" {question.answer.upper()} ")
        assert not question.is_right("")
        if question.answer.isdecimal():
            assert question.is_right(hex(int(question.answer)))
            assert not question.is_right(str(int(question.answer) + 1))


def test_the_answer_about_the_length_of_a_frame_is_what_a_controller_sends() -> None:
    asked = [one for one in islice(questions(1), 200) if one.text.startswith("How many bits is it")]
    assert asked
    for question in asked:
        assert question.answer == str(frame_bits(parse_frame(question.shown)).nominal_bits)
        octets, stuff = map(int, re.findall(r"\((\d+)\)", question.why))
        assert 47 + 8 * octets + stuff == int(question.answer), "what it says adds up"


def test_frames_of_a_real_bus_are_asked_about_as_made_up_ones_are() -> None:
    random = Random(5)
    frames = ["103#C181010000070108", "18A#C0FF", "700#", "07F#11"]
    asked = [(text, frame_question(parse_frame(text), random)) for text in frames for _ in range(30)]
    for text, question in asked:
        assert question is not None
        if question.text.startswith("Which node"):
            assert (text, question.answer) in (("103#C181010000070108", "3"), ("18A#C0FF", "10"))
        elif question.text.startswith("How many bits is it"):
            assert question.is_right(str(frame_bits(parse_frame(text)).nominal_bits))
        else:
            assert text in ("103#C181010000070108", "18A#C0FF"), "a run of bits needs some data"
    assert len({question.text.form for _, question in asked if question}) == 3
    for text in ("103##0C1", "00000103#C1", "103#R"):
        assert frame_question(parse_frame(text), random) is None


def test_stuff_bits_count_for_the_next_five() -> None:
    assert stuffed("11111") == "11111(0)"
    assert stuffed("111110000") == "11111(0)0000(1)"
    assert stuffed("0101") == "0101"


def test_the_quiz_is_graded() -> None:
    answers = [question.answer for question in islice(questions(3), 4)]
    done = CliRunner().invoke(quiz, ["--seed", "3", "--count", "4"], input="\n".join(answers) + "\n")
    assert done.exit_code == 0, done.output
    assert "4 of 4 are right." in done.output
    done = CliRunner().invoke(quiz, ["--seed", "3", "--count", "4"], input="\n" * 4)
    assert done.exit_code == 1
    assert f"No: {answers[0]}: " in done.output
    done = CliRunner().invoke(quiz, ["--seed", "3", "--count", "4", "--json"], input="\n".join(answers[:2]))
    assert json.loads(done.output)["right"] == 2


def test_a_recording_is_for_another_command(tmp_path: Path) -> None:
    path = tmp_path / "lesson.mcap"
    path.write_bytes(b"\x89MCAP0\r\n" + bytes(100))
    result = run(str(path))
    assert result.exit_code != 0
    assert f"msbot log show {path}" in str(result.exception)
