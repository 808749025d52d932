"""Octets in, octets out, or silence (R50, R52, R53)."""

from __future__ import annotations

from random import Random

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from msbot.part.join import pnp_messages, thesis_messages
from msbot.part.join.hardware_trouble import TROUBLE_OCTETS, TroublePiece, trouble_pieces
from msbot.part.join.home import VERSION, Home, home_text, read_home
from msbot.part.join.part_log import LEVEL_SHIFT, VersionOf
from msbot.pnp import Configuration, Keys, Refusal, SlotBinding
from msbot.pnp.requests import RequestHandler
from msbot_xrce.counting import MOST_NAMES, OTHERS
from tests.effort import tries
from tests.pnp.robot import Rig, configuration, uid

KEY = 0xAAAAAAAA


class Counter:
    """A rig with a handler of requests in front of it."""

    def __init__(self, *, explain: bool = False) -> None:
        self.rig = Rig()
        self.rig.join(KEY)
        self.requests = RequestHandler(self.rig.inventory, explain=explain)

    def ask(
        self,
        message: pnp_messages.ClaimMessage
        | pnp_messages.Beat
        | pnp_messages.NatureMessage
        | TroublePiece
        | pnp_messages.ConfigurationRequest,
        key: int = KEY,
    ) -> bytes | None:
        return self.requests.compact(message.encode(), key, self.rig.now)

    def register(self) -> pnp_messages.VerdictMessage:
        answer = self.ask(claim("ABCD"))
        assert answer is not None
        return pnp_messages.VerdictMessage.decode(answer)


def claim(number: str) -> pnp_messages.ClaimMessage:
    return pnp_messages.ClaimMessage(part_number=number, local_name="AA", uid=uid(1), session_nonce=7)


def test_a_listed_part_gets_lease_version_and_beat_period_and_nothing_more() -> None:
    counter = Counter()
    verdict = counter.register()
    assert verdict.lease
    assert (verdict.configuration_version, verdict.beat_period_ms, verdict.reason) == (1, 1000, 0)
    assert len(verdict.encode()) == 12
    part = counter.rig.part(KEY)
    assert (part.local_name, part.uid) == ("AA", uid(1))


def test_a_stranger_hears_nothing() -> None:
    counter = Counter()
    assert counter.ask(claim("NOPE")) is None
    assert counter.requests.compat(thesis_messages.encode_request("NOPE", "x"), KEY, counter.rig.now) is None
    assert counter.requests.dropped == {}


def test_who_only_asks_whether_this_is_the_thesis_own_master_is_no_newcomer() -> None:
    counter = Counter()
    question = thesis_messages.probe_request("ABCD", "AA")
    assert question is not None
    assert counter.requests.compat(question, KEY, counter.rig.now) is None
    assert counter.rig.part(KEY).part_number == "", "it has claimed nothing"


def test_a_robot_that_explains_tells_the_reason() -> None:
    counter = Counter(explain=True)
    answer = counter.ask(claim("NOPE"))
    assert answer is not None
    verdict = pnp_messages.VerdictMessage.decode(answer)
    assert (verdict.lease, verdict.reason) == (0, Refusal.UNKNOWN_PART)


def test_a_contested_claim_is_not_answered_even_by_a_robot_that_explains() -> None:
    counter = Counter(explain=True)
    counter.register()
    counter.rig.join(KEY + 1)
    assert counter.ask(claim("ABCD"), KEY + 1) is None


def test_a_beat_is_answered_with_the_configurations_version_or_0() -> None:
    counter = Counter()
    lease = counter.register().lease
    assert counter.ask(pnp_messages.Beat(lease=lease)) == pnp_messages.BeatReply(configuration_version=1).encode()
    assert counter.ask(pnp_messages.Beat(lease=lease ^ 1)) == pnp_messages.BeatReply(configuration_version=0).encode()


@pytest.mark.parametrize(("number", "nature"), [(1, "real"), (2, "simulated"), (3, "replayed"), (0, ""), (77, "")])
def test_a_part_says_what_is_behind_its_ports(number: int, nature: str) -> None:
    counter = Counter()
    lease = counter.register().lease
    assert counter.rig.part(KEY).nature.label == ""
    message = pnp_messages.NatureMessage(lease=lease, nature=number)
    assert len(message.encode()) == 5
    assert counter.ask(message) is None
    assert counter.rig.part(KEY).nature.label == nature
    counter.ask(pnp_messages.NatureMessage(lease=lease ^ 1, nature=1))
    assert counter.rig.part(KEY).nature.label == nature, "not by somebody without its lease"


def test_a_part_says_its_versions_and_another_one_is_noted_once() -> None:
    counter = Counter()
    lease = counter.register().lease

    def say(of: VersionOf, text: str, lease: int = lease) -> None:
        for piece in trouble_pieces(lease, text):
            piece.place |= of << LEVEL_SHIFT
            assert counter.ask(piece) is None

    def history() -> str:
        return "\n".join(counter.rig.inventory.why(counter.rig.part(KEY).part, counter.rig.now))

    say(VersionOf.SOFTWARE, "1.0")
    say(VersionOf.HARDWARE, "a board with a long name")
    said = counter.rig.part(KEY)
    assert (said.hardware, said.software) == ("a board with a long name", "1.0")
    assert "(ABCD, hardware a board with a long name, software 1.0) is active" in history()
    say(VersionOf.SOFTWARE, "9", lease ^ 1)
    say(VersionOf.SOFTWARE, "1.0")
    assert counter.rig.part(KEY).software == "1.0"
    assert "it was" not in history()
    say(VersionOf.SOFTWARE, "1.1")
    assert counter.rig.part(KEY).software == "1.1"
    assert "its software is 1.1; it was 1.0" in history()


def test_a_part_says_where_it_runs_and_what_is_not_known_here_counts_for_nothing() -> None:
    counter = Counter()
    lease = counter.register().lease

    def say(kind: int, text: str) -> None:
        for piece in trouble_pieces(lease, text):
            piece.place |= kind << LEVEL_SHIFT
            assert counter.ask(piece) is None

    def why() -> str:
        return "\n".join(counter.rig.inventory.why(counter.rig.part(KEY).part, counter.rig.now))

    def told() -> tuple[str, str]:
        info = counter.rig.part(KEY)
        return info.home, info.msbot

    assert told() == ("", ""), "a part of before says nothing"
    assert "with MsBOT" not in why()
    say(VersionOf.HOME, home_text(Home.MICROPYTHON))
    assert told() == ("MicroPython", VERSION)
    assert f"It runs under MicroPython, with MsBOT {VERSION}." in why()
    say(7, "of a kind that only a later version knows")
    assert told() == ("MicroPython", VERSION)
    assert (counter.rig.part(KEY).hardware, counter.rig.part(KEY).software) == ("", "")
    say(VersionOf.HOME, "MPy 99.1.0")
    assert f"it runs with MsBOT 99.1.0; before, it was {VERSION}" in why()
    say(VersionOf.HOME, "Mars 99.1.0")
    assert told() == ("", "99.1.0"), "a word that only a later version knows"
    assert [read_home(home_text(home)).home for home in Home] == list(Home)
    assert all(len(home_text(home)) <= TROUBLE_OCTETS for home in Home), (
        "one piece, as long as versions have five digits"
    )


def test_the_configuration_travels_whole() -> None:
    counter = Counter()
    lease = counter.register().lease
    answer = counter.ask(pnp_messages.ConfigurationRequest(lease=lease, have_version=0))
    assert answer is not None
    sent = pnp_messages.ConfigurationMessage.decode(answer)
    ours = configuration("AA")
    assert (sent.version, sent.slot) == (ours.version, ours.slot)
    assert [(b.port, b.topic, b.topic_type, b.direction, b.reliable) for b in sent.bindings] == [
        ("out", "HelloWorldTopic_1_to_2", "HelloWorld", pnp_messages.BindingDirection.PUBLISH, 1),
        ("in", "HelloWorldTopic_3_to_1", "HelloWorld", pnp_messages.BindingDirection.SUBSCRIBE, 0),
    ]
    assert [(s.name, s.value) for s in sent.settings] == [("period_s", "1.0")]


def test_a_configuration_for_an_unknown_lease_is_not_answered() -> None:
    assert Counter().ask(pnp_messages.ConfigurationRequest(lease=5, have_version=0)) is None


def test_a_configuration_that_cannot_be_encoded_is_counted_not_raised() -> None:
    counter = Counter()
    binding = SlotBinding("p" * 300, "t", "T", publishes=True)
    counter.rig.store.configurations["AA"] = Configuration(1, "AA", (binding,))
    lease = counter.register().lease
    assert counter.ask(pnp_messages.ConfigurationRequest(lease=lease, have_version=0)) is None
    (reason,) = counter.requests.dropped
    assert reason.startswith("answer: ")


def test_an_original_program_gets_its_number_back_and_every_request_is_a_beat() -> None:
    counter = Counter()
    request = thesis_messages.encode_request("ABCD", "ABCD-local")
    for beats in range(3):
        assert counter.requests.compat(request, KEY, counter.rig.now) == thesis_messages.encode_reply("ABCD")
        assert counter.rig.part(KEY).beats == beats


def test_a_claim_for_a_uid_of_zeros_is_that_of_a_part_without_uid() -> None:
    counter = Counter()
    counter.ask(pnp_messages.ClaimMessage(part_number="ABCD", local_name="", uid=bytes(8), session_nonce=0))
    assert counter.rig.part(KEY).uid == b""


@pytest.mark.parametrize("body", [b"", b"abc", bytes(9), b"\xff" * 40])
def test_nonsense_is_counted_by_reason_and_not_answered(body: bytes) -> None:
    counter = Counter(explain=True)
    assert counter.requests.compact(body, KEY, 0.0) is None
    assert counter.requests.compat(body, KEY, 0.0) is None
    assert sum(counter.requests.dropped.values()) == 2
    assert all(reason.startswith("request: ") for reason in counter.requests.dropped)


@given(st.binary(max_size=120), st.booleans())
@settings(max_examples=tries(200, 4000), deadline=None)
def test_any_octets_at_all_never_raise(body: bytes, explain: bool) -> None:
    counter = Counter(explain=explain)
    counter.requests.compact(body, KEY, counter.rig.now)
    counter.requests.compat(body.ljust(96, b"\0")[:96], KEY, counter.rig.now)


def test_wrong_requests_of_all_sizes_are_counted_under_a_bounded_number_of_reasons() -> None:
    counter = Counter()
    for size in range(200, 1200):
        assert counter.requests.compat(bytes(size), KEY, counter.rig.now) is None
        request = size.to_bytes(4, "little") + bytes(92)
        assert counter.requests.compat(request, KEY, counter.rig.now) is None
    assert len(counter.requests.dropped) == MOST_NAMES + 1
    assert sum(counter.requests.dropped.values()) == 2000
    assert counter.requests.dropped[OTHERS] == 2000 - MOST_NAMES


@pytest.mark.parametrize("right", [True, False])
def test_what_is_said_with_a_lease_is_taken_from_its_holder_alone(right: bool) -> None:
    counter = Counter()
    rig = counter.rig
    lease = counter.register().lease ^ (not right)
    now = rig.now
    said: list[pnp_messages.Request] = [
        pnp_messages.NatureMessage(lease=lease, nature=2),
        *trouble_pieces(lease, "the sensor is not there"),
        pnp_messages.ConfigurationRequest(lease=lease, have_version=0),
        pnp_messages.Beat(lease=lease),
        pnp_messages.StoppedBeat(lease=lease, number=1),
        pnp_messages.Proof(proof=bytes(16)),
    ]
    answers = [counter.requests.answer(one, KEY, now) for one in said]
    version = pnp_messages.BeatReply(configuration_version=int(right))
    assert [type(one).__name__ for one in answers if one not in (None, version)] == ["ConfigurationMessage"] * right
    assert answers.count(version) == 2
    assert (rig.part(KEY).nature.label, rig.part(KEY).beats) == (("simulated", 2) if right else ("", 0))
    unasked = {"request: a proof that nobody asked for": 1}
    wrong = {"nature with an unknown lease": 1, "trouble with an unknown lease": 2}
    assert counter.requests.dropped == (unasked if right else {**wrong, **unasked})
    lost = {"request for a configuration with an unknown lease": 1, "beat with an unknown lease": 2}
    assert rig.inventory.dropped == ({} if right else lost)
    rig.leave(KEY, "gone", politely=False)
    assert rig.part(KEY).reason == ("gone; it said: the sensor is not there" if right else "gone")


def test_an_answer_that_cannot_be_encoded_is_counted_and_not_sent() -> None:
    counter = Counter()
    too_long = pnp_messages.ConfigurationMessage(version=1, slot="AA", bindings=[], settings=[])
    binding = pnp_messages.PortBinding(port="p", topic="t", topic_type="T", direction=0, reliable=1)
    too_long.bindings.extend([binding] * (pnp_messages.MOST_BINDINGS + 1))
    assert counter.requests.encode(too_long, KEY) is None
    assert counter.requests.encode(None, KEY) is None
    ((reason, count),) = counter.requests.dropped.items()
    assert (reason[:8], count) == ("answer: ", 1)


@pytest.mark.parametrize("explain", [True, False])
def test_a_claim_without_a_key_on_file_is_refused_and_explained_where_that_is_done(explain: bool) -> None:
    counter = Counter(explain=explain)
    counter.requests = RequestHandler(counter.rig.inventory, explain=explain, keys=Keys(counter.rig.store, Random(1)))
    answer = counter.ask(claim("ABCD"))
    refused = pnp_messages.VerdictMessage(
        lease=0, configuration_version=0, beat_period_ms=1000, reason=Refusal.NO_KEY
    ).encode()
    assert answer == (refused if explain else None)
    assert counter.rig.part(KEY).refusal is Refusal.NO_KEY
    counter.rig.store.keys[uid(1)] = bytes(16)
    question = counter.ask(claim("ABCD"))
    assert question is not None
    assert len(pnp_messages.Challenge.decode(question).nonce) == 16
