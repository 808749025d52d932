"""What fuzzing has found in parsers, each once more: it is refused in words, or read."""

from __future__ import annotations

import json
import zlib
from pathlib import Path

import pytest

from fuzz.case import Step
from fuzz.targets import TARGETS
from fuzz.targets.parsers import PARSERS, read, samples_of
from fuzz.targets.sockets import GREETING
from msbot.cli.bus.frame_log import FrameReader
from msbot_agent.text.sentence import printable, whole
from msbot_agent.text.untrusted_input import read_json
from msbot_web.access.accounts import Accounts
from msbot_web.access.users import MemoryUsers
from msbot_web.nicegui_internals.page_sockets import NONSENSE, TOO_SLOW
from msbot_xrce.errors import ConfigError
from tests.web.access.test_accounts import PlainHasher, user

DEEP = b"[" * 100_000


def _blf_with_a_damaged_container() -> bytes:
    octets = bytearray(samples_of("blf")[0])
    at = octets.index(zlib.compress(b"")[:1], 150)
    octets[at : at + 40] = bytes(40)
    return bytes(octets)


@pytest.mark.parametrize(
    ("parser", "octets"),
    [
        pytest.param("arena", b'{"do": {"wheels": {"motor.left": 1%s}}}' % (b"0" * 400), id="no float is so large"),
        pytest.param("arena", DEEP, id="deep line"),
        pytest.param("blocks", b'{"a": "\\ud800"}', id="half a character"),
        pytest.param("stop_answer", DEEP, id="deep answer about STOP"),
        pytest.param("ros", b"int32 a\nuint8 B=\x1b[31m", id="escape sequence in a constant"),
        pytest.param("ros", b"bool[2] flags " + b"[" * 5000, id="deep default"),
        pytest.param("candump", "can0 123 [2] DE\u00a0AD".encode(), id="another space"),
        pytest.param("trc", b";$FILEVERSION=2.1\r\n;$STARTTIME=25500000173", id="a day that no calendar has"),
        pytest.param("asc", b"date Wed\x1b[31m\nbase hex", id="escape sequence in a log"),
        pytest.param("recording", b"\x89MCAP\r\r\n" + bytes(40), id="a version that controls the terminal"),
        pytest.param("recording", b"\x89MCAP0\r\n" + bytes(40), id="bytes that are no record"),
        pytest.param("pass", b"\xff", id="a proof that is no text behind the right name and time"),
        pytest.param(
            "sessions",
            b'{"at": 1e12, "forward_s": 1e12, "boot": "start", "boot_s": 0.0, "ticket_key": "%s", '
            b'"browsers": [["a", "bob"]], "sessions": [{"key": "a", '
            b'"name": "bob", "csrf": "x", "age_s": "old", "idle_s": 1, "guest_of": ""}]}' % (b"00" * 32),
            id="an age in words",
        ),
        pytest.param("sessions", b'{"at": 1%s, "sessions": []}' % (b"0" * 400), id="a time that no float is"),
        pytest.param("stop_request", b'{"do": "stop", "who": "\\udcff", "reason": "\\ud800"}', id="half a reason"),
        pytest.param("stop_request", b'{"do": "go", "expires": 1%s}' % (b"0" * 400), id="a GO without end"),
        pytest.param(
            "stop_record",
            b'{"number": 1e999, "holds": true, "by": "", "reason": "", "at_ns": 1}',
            id="the infinite STOP",
        ),
        pytest.param("board", b"5", id="a board that answers something of another kind"),
        pytest.param("board", b"(0, 0, 0, 0)", id="a board whose blocks have no bytes"),
        pytest.param("board", b"(" * 3000, id="a deep answer of a board"),
        pytest.param("board_settings", b'{"a": NaN}', id="settings that no board could read again"),
        pytest.param("status_file", b'{"port": 1e999, "token": "", "pid": 1}', id="the infinite port"),
        pytest.param(
            "bus_file",
            b'{"name": "x", "port": 1e999, "key": "", "pid": 1, "data_bitrate": null}',
            id="the infinite port of a bus",
        ),
        pytest.param("rollouts", b"{}", id="no list of roll-outs"),
        pytest.param("rollouts", b'[{"at": 1%s, "blueprint": "", "done": []}]' % (b"0" * 400), id="when was that?"),
        pytest.param("request", b'window {"seconds": 1%s}' % (b"0" * 400), id="a number that is none"),
        pytest.param("request", b'undo {"edit": 1%s}' % (b"0" * 400), id="the edit of that number"),
        pytest.param("request", b'stop {"reason": "\\ud800"}', id="half a reason in a request"),
        pytest.param("request", b'stop {"\\u001b[31m": 1}', id="an argument that controls the terminal"),
    ],
)
@pytest.mark.promise("Hostile packets and files end in a sentence or a count, never a traceback")
def test_what_was_found_is_read_or_refused_in_printable_words(parser: str, octets: bytes) -> None:
    read(parser, octets)


@pytest.mark.promise("Hostile packets and files end in a sentence or a count, never a traceback")
def test_a_damaged_log_of_another_program_is_one_sentence(tmp_path: Path) -> None:
    path = tmp_path / "a.blf"
    path.write_bytes(_blf_with_a_damaged_container())
    with pytest.raises(ConfigError, match=r"a\.blf is no \.blf file that python-can understands"):
        list(FrameReader().read(str(path)))


@pytest.mark.parametrize("note", [b"{", DEEP, b"[]", b"7", b"{}", b'{"began_ms": "x"}', b'{"began_ms": 5, "head": 3}'])
def test_notes_of_a_mission_that_make_no_sense_are_passed_over(note: bytes) -> None:
    good = samples_of("recording")[0]
    notes = json.loads(good[good.index(b'{"slot"') : good.index(b"}}", good.index(b'{"slot"')) + 2])
    wanted = json.dumps(notes).encode()
    assert wanted in good  # without compression, so that it can be exchanged for something of the same length
    damaged = good.replace(wanted, note[: len(wanted)].ljust(len(wanted)), 3)
    read("recording", damaged)


def test_deep_json_is_an_error_of_value() -> None:
    with pytest.raises(ValueError, match="nested too deeply"):
        read_json(DEEP)
    assert read_json(b'{"a": 1}') == {"a": 1}


def test_what_controls_a_terminal_is_shown_as_question_marks() -> None:
    assert printable("plain ä") == "plain ä"
    assert printable("a\x1b[31m\nb\u2028") == "a?[31m?b?"


@pytest.mark.parametrize("name", PARSERS)
def test_every_sample_is_read(name: str) -> None:
    assert samples_of(name)
    for sample in samples_of(name):
        assert read(name, sample)


def test_a_program_that_is_none_of_ours_answers_at_the_port_of_one_that_has_ended() -> None:
    for answer in (b"[1]", b"7", b'{"format": 1}', b'{"format": 1}\n{"end": 0}'):
        assert read("status", answer)


def test_words_are_made_whole_without_touching_what_is() -> None:
    assert whole("plain \U0001f916") == "plain \U0001f916"
    assert whole("a\udcffb\ud800") == "a?b?"


@pytest.mark.promise("Hostile packets and files end in a sentence or a count, never a traceback")
def test_what_was_found_in_requests_is_answered() -> None:
    """An origin that is no address, a length of 5,000 digits, half a character in a ticket and in a body.

    What is odd about a STOP is dropped, and the robot stops.
    """
    found = (
        ("head POST /login", b"origin: http://[", 403),
        ("head POST /login", b"content-length: " + b"9" * 5000, 400),
        ("form POST /pass", b"ticket=YWRh.ffffffff.%ED%A0%80", 403),
        ("call POST /api/stop", b'{"reason": "\\ud800"}', 200),
    )
    seen = TARGETS["page"].run(tuple(Step(verb, octets, (2,)) for verb, octets, _ in found))
    assert {f"{verb.partition(' ')[2]} {status}" for verb, _, status in found} <= {*seen}, seen


@pytest.mark.parametrize(
    "octets",
    [
        pytest.param(b"x", id="no packet"),
        pytest.param(b"4" + b"[" * 5000, id="a deep packet"),
        pytest.param(b'42[["event"]]', id="an event that is a list"),
        pytest.param(b'42["connect",5]', id="coming, said as an event"),
        pytest.param(b'42["event",{"client_id":"PAGE1"}]', id="a click on nothing"),
        pytest.param(b'42["event",{"client_id":"PAGE1","id":4,"listener_id":"x","args":["{"]}]', id="half an argument"),
        pytest.param(b'42["ack",{"client_id":"PAGE1","next_message_id":"x"}]', id="an ACK in words"),
        pytest.param(b'42["javascript_response",{"client_id":"PAGE1","request_id":[]}]', id="an answer to a list"),
        pytest.param(b'451-["event",{"_placeholder":true,"num":0}]', id="something that never comes"),
        pytest.param(b"\xff\xfe", id="octets"),
    ],
)
@pytest.mark.promise("Hostile packets and files end in a sentence or a count, never a traceback")
def test_what_was_found_in_websockets_of_the_page_goes_no_further(octets: bytes) -> None:
    greeting = GREETING.replace("{0}", "7").encode()
    steps = (Step("open", greeting, (1, 1)), Step("say", b"40"), Step("wait", b"", (0, 0, 0.1)), Step("say", octets))
    assert any(NONSENSE in words for words in TARGETS["sockets"].run((*steps, Step("wait", b"", (0, 0, 0.1)))))


def test_a_page_that_says_its_handshake_wrong_is_not_kept_for_ever() -> None:
    """Formerly its number of connections was counted before the values were looked at, and never down again."""
    steps = [Step("open", b"", (1, 1)), Step("say", b"40"), Step("wait", b"", (0, 0, 0.1))]
    for field in (b'"document_id":{}', b'"document_id":"d","next_message_id":"x"'):
        steps.append(Step("say", b'42["handshake",{"client_id":"PAGE1","tab_id":"t",%s}]' % field))
    assert any("(handshake)" in words for words in TARGETS["sockets"].run((*steps, Step("wait", b"", (0, 0, 0.1)))))


def test_a_browser_that_takes_nothing_loses_its_connection() -> None:
    steps = [Step("open", GREETING.encode(), (1, 1)), Step("say", b"40"), Step("wait", b"", (0, 0, 0.1))]
    steps += [Step("read", b"", (0, 0)), *(Step("work", b"", (2500, 4000)),) * 2]
    for _ in range(6):  # it says that it is there all the same
        steps += [Step("say", b"3"), Step("wait", b"", (0, 0, 4.0))]
    assert any(TOO_SLOW in words for words in TARGETS["sockets"].run(tuple(steps)))


async def test_a_device_cookie_that_is_no_text_of_ours_signs_in_like_none() -> None:
    accounts = Accounts(MemoryUsers(user("ada", password="correct horse")), clock=lambda: 5.0, hasher=PlainHasher())
    for device in ("\xe4", "\udcff", accounts.browsers.note_sign_in("", "ada")):
        assert (await accounts.sign_in("ada", "correct horse", "10.0.0.1", device)).name == "ada"
