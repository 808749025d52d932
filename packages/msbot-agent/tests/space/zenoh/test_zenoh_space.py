"""Two data spaces and a router on one computer: what crosses, what is promised, and what is told."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Iterator
from pathlib import Path

import pytest

from msbot_agent.space import DdsTopic, Qos, Topic, open_space, parse_space
from msbot_agent.space.zenoh import Allowed, Router, ZenohSpace
from msbot_agent.space.zenoh.zenoh_library import load
from msbot_xrce.errors import ConfigError
from tests.space.dds.peers import Inbox, until
from tests.space.zenoh.conftest import tls_of
from tests.space.zenoh.sites import HERE, SECURE

LIGHT = Topic("rt/light", "std_msgs::msg::dds_::Float32_")
RELIABLE = Qos(depth=64)
KEPT = Qos(transient_local=True, depth=64)


def guid(number: int) -> bytes:
    """A writer's."""
    return number.to_bytes(16)


@pytest.fixture
async def pair(router: Router) -> Iterator[tuple[ZenohSpace, ZenohSpace]]:  # type: ignore[misc]
    """Here and there."""
    with ZenohSpace([HERE]) as here, ZenohSpace([HERE]) as there:
        yield here, there


async def matched(writer: object) -> None:
    """Wait until the writer has a reader elsewhere."""
    await until(lambda: writer.outlets[0].is_wanted)  # type: ignore[attr-defined]


async def test_octets_arrive_elsewhere_as_they_were_written(pair: tuple[ZenohSpace, ZenohSpace]) -> None:
    here, there = pair
    inbox = Inbox()
    there.reader(LIGHT, KEPT, inbox)
    writer = here.writer(LIGHT, KEPT, guid(1))
    sent = [bytes(range(size % 256)) * 3 for size in (0, 1, 5, 64, 255)] + [b"", bytes(1 << 20), b"end"]
    for payload in sent:
        writer.write(payload)  # the first ones before anybody is there
    await until(lambda: len(inbox.samples) == len(sent))
    assert inbox.payloads == sent
    assert [sample.sequence_nr for sample in inbox.samples] == list(range(1, len(sent) + 1))
    assert len({sample.writer for sample in inbox.samples}) == 1


async def test_endpoints_of_one_space_meet_in_memory_at_once_and_only_there(
    pair: tuple[ZenohSpace, ZenohSpace],
) -> None:
    here, there = pair
    near, far = Inbox(), Inbox()
    here.reader(LIGHT, RELIABLE, near)
    there.reader(LIGHT, RELIABLE, far)
    writer = here.writer(LIGHT, RELIABLE, guid(1))
    await matched(writer)
    for number in range(10):
        writer.write(b"%d" % number)
        assert len(near.samples) == number + 1  # within the call
    await until(lambda: len(far.samples) == 10)
    assert near.payloads == far.payloads == [b"%d" % index for index in range(10)]  # none came a second time


async def test_a_late_reader_gets_the_newest_samples_and_a_volatile_one_none(
    pair: tuple[ZenohSpace, ZenohSpace],
) -> None:
    here, there = pair
    writer = here.writer(LIGHT, Qos(transient_local=True, depth=3), guid(1))
    for number in range(5):
        writer.write(b"%d" % number)
    await until(lambda: here.is_up and there.is_up)
    late, volatile = Inbox(), Inbox()
    there.reader(LIGHT, KEPT, late)
    there.reader(LIGHT, RELIABLE, volatile)
    await until(lambda: len(late.samples) == 3 and len(writer.outlets[0]._readers) == 2)  # type: ignore[attr-defined]
    writer.write(b"new")
    await until(lambda: late.payloads[-1:] == volatile.payloads[-1:] == [b"new"])
    assert late.payloads == [b"2", b"3", b"4", b"new"]
    assert volatile.payloads == [b"new"]


@pytest.mark.parametrize(
    ("offered", "requested", "words"),
    [
        (Qos(reliable=False), Qos(), "RELIABILITY: the reader asks for RELIABLE, the writer offers BEST_EFFORT"),
        (Qos(), KEPT, "DURABILITY: the reader asks for TRANSIENT_LOCAL, the writer offers VOLATILE"),
        (Qos(), Qos(exclusive=True), "OWNERSHIP: the reader asks for EXCLUSIVE, the writer offers SHARED"),
        (Qos(deadline_s=2.0), Qos(deadline_s=0.5), "DEADLINE: the reader asks for 0.5 s, the writer offers 2 s"),
    ],
)
async def test_what_cannot_match_is_told_at_both_ends_and_nothing_arrives(
    pair: tuple[ZenohSpace, ZenohSpace], offered: Qos, requested: Qos, words: str, caplog: pytest.LogCaptureFixture
) -> None:
    here, there = pair
    inbox, other = Inbox(), Inbox()
    reader = there.reader(LIGHT, requested, inbox)
    there.reader(LIGHT, Qos(reliable=False, deadline_s=offered.deadline_s), other)  # so that samples are sent
    writer = here.writer(LIGHT, offered, guid(1))
    sentence = f"rt/light: {words} (a Zenoh peer)"
    await until(lambda: sentence in writer.troubles() and sentence in reader.troubles())
    await matched(writer)
    writer.write(b"hidden")
    await until(lambda: other.samples)
    assert inbox.samples == []
    assert sentence in caplog.messages
    reader.close()
    await until(lambda: writer.troubles() == ())


async def test_a_topic_with_another_type_is_told(pair: tuple[ZenohSpace, ZenohSpace]) -> None:
    here, there = pair
    writer = here.writer(Topic("light", "Light"), RELIABLE, guid(1))
    reader = there.reader(Topic("light", "Foreign"), RELIABLE, Inbox())
    await until(lambda: writer.troubles() and reader.troubles())
    assert writer.troubles() == ("light: TYPE: it is read as Foreign by a Zenoh peer, here it is Light",)
    assert reader.troubles() == ("light: TYPE: it is written as Light by a Zenoh peer, here it is Foreign",)


async def test_robots_do_not_hear_each_other_and_exported_topics_are_heard_by_all(router: Router) -> None:
    names = (DdsTopic("light", "Light", ("ROVER", "")),)
    with (
        ZenohSpace([HERE], partition="ROVER", dds_topics_of=lambda _: names) as rover,
        ZenohSpace([HERE], partition="OTHER") as robot,
        ZenohSpace([HERE]) as everybody,
    ):
        topic = Topic("light", "Light")
        inboxes = [Inbox(), Inbox(), Inbox(), Inbox()]
        robot.reader(topic, RELIABLE, inboxes[0])
        everybody.reader(topic, RELIABLE, inboxes[1])
        everybody.reader(topic, Qos(depth=64, partitions=("RO*",)), inboxes[2])
        everybody.reader(topic, Qos(depth=64, partitions=("", "ROVER")), inboxes[3])  # it hears both names
        writer = rover.writer(topic, KEPT, guid(1))
        await until(lambda: all(outlet.is_wanted for outlet in writer.outlets))  # type: ignore[attr-defined]
        for number in range(20):
            writer.write(b"%d" % number)
        await until(lambda: all(inbox.payloads[-1:] == [b"19"] for inbox in inboxes[1:]))
        assert [len(inbox.samples) for inbox in inboxes] == [0, 20, 20, 20]
        assert "PARTITION" in rover.writer(topic, Qos(partitions=("R*",)), guid(2)).troubles()[0]


async def test_requests_are_answered_to_whom_they_came_from(pair: tuple[ZenohSpace, ZenohSpace]) -> None:
    here, there = pair
    qos = Qos(depth=64, service=True)
    asked, answered = Topic("rq/addRequest", "Add_Request_"), Topic("rr/addReply", "Add_Reply_")
    answers: dict[int, Inbox] = {1: Inbox(), 2: Inbox()}
    replies = there.writer(answered, qos, guid(9))
    there.reader(asked, qos, lambda sample: replies.write(sample.payload * 2, (sample.writer, sample.sequence_nr)) > 0)
    requests = {}
    for number, inbox in answers.items():
        here.reader(answered, qos, inbox)
        requests[number] = here.writer(asked, qos, guid(number))
    await until(lambda: all(request.outlets[0].is_wanted for request in requests.values()))  # type: ignore[attr-defined]
    await until(lambda: replies.outlets[0].is_wanted)  # type: ignore[attr-defined]
    requests[1].write(b"a")
    requests[2].write(b"b")
    await until(lambda: all(len(inbox.samples) == 2 for inbox in answers.values()))
    for inbox in answers.values():  # as in memory: every reader of the topic sees whom each answer is for
        assert {(sample.payload, sample.related) for sample in inbox.samples} == {
            (b"aa", (guid(1), 1)),
            (b"bb", (guid(2), 1)),
        }


async def test_other_services_stay_in_the_process(pair: tuple[ZenohSpace, ZenohSpace]) -> None:
    here, _ = pair
    writer = here.writer(Topic("msbot/inventory", "Claim"), Qos(service=True), guid(1))
    assert not hasattr(writer, "outlets")


async def test_what_was_promised_comes_after_a_cut_and_what_is_lost_is_told(caplog: pytest.LogCaptureFixture) -> None:
    inbox = Inbox()
    first = Router([HERE])
    with ZenohSpace([HERE]) as here, ZenohSpace([HERE]) as there:
        reader = there.reader(LIGHT, RELIABLE, inbox)
        writer = here.writer(LIGHT, RELIABLE, guid(1))
        await matched(writer)
        writer.write(b"0")
        await until(lambda: inbox.samples)

        first.__exit__()
        await until(lambda: not here.is_up and not there.is_up)
        assert f"the Zenoh router at {HERE} is lost; it is tried again until it answers" in caplog.messages
        for number in range(1, 65):  # as many as are kept
            writer.write(b"%d" % number)
        second = Router([HERE])
        await until(lambda: len(inbox.samples) == 65)
        assert inbox.payloads == [b"%d" % number for number in range(65)]
        assert reader.troubles() == ()
        assert f"the Zenoh router at {HERE} is heard again" in caplog.messages

        second.__exit__()
        await until(lambda: not here.is_up and not there.is_up)
        for number in range(100):  # more than are kept
            writer.write(b"%d" % number)
        with Router([HERE]):
            await until(lambda: inbox.payloads[-1] == b"99" and reader.troubles())
            assert inbox.payloads[65:] == [b"%d" % number for number in range(36, 100)]
            words = "rt/light: 36 samples were lost on the way from a Zenoh peer"
            assert reader.troubles() == (words,)
            assert words in caplog.messages


async def test_without_a_router_the_robot_works_and_says_so_once(caplog: pytest.LogCaptureFixture) -> None:
    near, far = Inbox(), Inbox()
    with ZenohSpace(["tcp/127.0.0.1:7440", HERE]) as here:
        here.reader(LIGHT, KEPT, near)
        writer = here.writer(LIGHT, KEPT, guid(1))
        writer.write(b"kept")
        assert near.payloads == [b"kept"]
        await until(lambda: caplog.messages)
        assert caplog.messages == [
            f"no Zenoh router at tcp/127.0.0.1:7440 (Connection refused), {HERE} (Connection refused); "
            "it is tried again until it answers"
        ]
        with Router([HERE]), ZenohSpace([HERE]) as there:
            there.reader(LIGHT, KEPT, far)
            await until(lambda: far.payloads == [b"kept"])
    assert len(caplog.messages) == 1


@pytest.mark.parametrize("qos", [Qos(depth=64), Qos(reliable=False, depth=64)], ids=["reliable", "best effort"])
async def test_a_flood_stops_nobody_and_every_loss_of_a_reliable_sample_is_told(
    pair: tuple[ZenohSpace, ZenohSpace], qos: Qos
) -> None:
    here, there = pair
    inbox, number = Inbox(), 20_000
    reader = there.reader(LIGHT, qos, inbox)
    writer = here.writer(LIGHT, qos, guid(1))
    await matched(writer)
    for index in range(number):  # without ever letting the loop run
        writer.write(index.to_bytes(4) + bytes(252))

    def lost() -> int:
        return reader.inlets[0].lost  # type: ignore[attr-defined,no-any-return]

    if qos.reliable:
        await until(lambda: len(inbox.samples) + lost() == number)
    while b"after" not in inbox.payloads:  # best effort may lose the first ones as well
        writer.write(b"after")
        await asyncio.sleep(0.01)
    came = [int.from_bytes(payload[:4]) for payload in inbox.payloads if payload != b"after"]
    assert came == sorted(set(came))
    if lost():
        assert reader.troubles() == (f"rt/light: {lost()} samples were lost on the way from a Zenoh peer",)


async def test_what_makes_no_sense_is_counted(pair: tuple[ZenohSpace, ZenohSpace]) -> None:
    here, there = pair
    inbox = Inbox()
    reader = there.reader(LIGHT, Qos(reliable=False), inbox)
    writer = here.writer(LIGHT, Qos(reliable=False), guid(1))
    await matched(writer)
    config = load().Config.from_json5(f'{{mode: "client", connect: {{endpoints: ["{HERE}"]}}}}')
    with load().open(config) as foreign:
        key = reader.inlets[0].key  # type: ignore[attr-defined]
        foreign.put(key, b"without an envelope")
        foreign.put(key, b"cut", attachment=bytes(20))
        foreign.put(key, b"of another version", attachment=b"\2" + bytes(37))
        foreign.put(key, b"with a strange time", attachment=b"\1" + bytes(29) + b"\xff" * 8)
        foreign.liveliness().declare_token(f"{key}/@graph/w/zz/1/0")
        foreign.liveliness().declare_token(f"{key}/@graph/x")
        await until(reader.troubles)
        writer.write(b"sense")
        await until(lambda: inbox.samples and "4 samples" in reader.troubles()[0])
    assert inbox.payloads == [b"sense"]
    assert reader.troubles() == ("rt/light: 4 samples of Zenoh peers made no sense",)


async def test_a_closed_reader_gets_nothing_and_a_closed_writer_gives_nothing(
    pair: tuple[ZenohSpace, ZenohSpace],
) -> None:
    here, there = pair
    inbox, seen, late = Inbox(), Inbox(), Inbox()
    reader = there.reader(LIGHT, KEPT, inbox)
    watching = there.reader(LIGHT, KEPT, seen)
    writer = here.writer(LIGHT, KEPT, guid(1))
    await matched(writer)
    writer.write(b"1")
    await until(lambda: inbox.samples)
    reader.close()
    reader.close()
    writer.write(b"2")
    writer.close()
    await until(lambda: not watching.inlets[0]._neighbours)  # type: ignore[attr-defined]
    await until(lambda: seen.payloads == [b"1", b"2"])  # the word that the writer has closed overtakes its samples
    other = here.writer(LIGHT, KEPT, guid(2))
    other.write(b"3")
    there.reader(LIGHT, KEPT, late)
    await until(lambda: late.samples)
    assert (inbox.payloads, late.payloads) == ([b"1"], [b"3"])


# Certificates and rules.


async def test_with_certificates_only_what_is_allowed_passes(certificates: Path) -> None:
    allowed = [Allowed(("north",), ("ROVER/**",), receives=False), Allowed(("south",), ("ROVER/**",), sends=False)]
    with (
        Router([SECURE], tls=tls_of(certificates, "router"), allowed=allowed),
        ZenohSpace([SECURE], tls=tls_of(certificates, "north")) as north,
        ZenohSpace([SECURE], tls=tls_of(certificates, "south")) as south,
    ):
        rover, other = Qos(KEPT.reliable, transient_local=True, depth=64, partitions=("ROVER",)), KEPT
        inboxes = [Inbox(), Inbox(), Inbox()]
        south.reader(LIGHT, other, inboxes[0])
        north.writer(LIGHT, other, guid(2)).write(b"no")  # not allowed: no rule
        back = Topic("back", "Back")
        north.reader(back, rover, inboxes[1])
        south.writer(back, rover, guid(3)).write(b"no")  # not allowed: north only sends, south only receives
        north.writer(LIGHT, rover, guid(1)).write(b"yes")  # kept for the late reader
        await until(lambda: north.is_up and south.is_up)
        south.reader(LIGHT, rover, inboxes[2])
        await until(lambda: inboxes[2].samples)
        await asyncio.sleep(0.1)  # whatever came wrongly would be here as well
        assert [inbox.payloads for inbox in inboxes] == [[], [], [b"yes"]]


@pytest.mark.parametrize(
    ("name", "ca", "words"),
    [
        (None, "ca", "it does not accept our certificate, or wants one"),
        ("stranger", "ca", "it does not accept our certificate, or wants one"),
        ("north", "stranger", "its certificate is not accepted here: unable to get local issuer certificate"),
    ],
)
async def test_a_refused_certificate_is_told_in_a_sentence(
    certificates: Path, name: str | None, ca: str, words: str, caplog: pytest.LogCaptureFixture
) -> None:
    with (
        Router([SECURE], tls=tls_of(certificates, "router")),
        ZenohSpace([SECURE], tls=tls_of(certificates, name, ca)) as space,
    ):
        await until(lambda: caplog.messages)
        assert words in caplog.messages[0]
        assert not space.is_up


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ("ca=nothing.pem", "nothing.pem: cannot be read (No such file or directory); it should be a PEM file"),
        ("ca=router.csr", "router.csr: is no certificate in PEM form"),
        ("ca=ca.pem&cert=north.pem&key=south.key", "do not belong together"),
        ("ca=ca.pem&cert=north.csr&key=north.key", "are no certificate and its key in PEM form"),
    ],
)
async def test_files_that_are_no_certificates_are_told_at_the_start(
    certificates: Path, options: str, words: str
) -> None:
    address = parse_space(f"zenoh:{SECURE}?{options}", folder=certificates)
    with pytest.raises(ConfigError, match=words.replace("(", r"\(").replace(")", r"\)")):
        open_space(address)


async def test_something_else_at_the_address_is_told(caplog: pytest.LogCaptureFixture) -> None:
    async def hang_up(_reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        writer.close()

    server = await asyncio.start_server(hang_up, "127.0.0.1", 7447)
    async with server:
        with ZenohSpace([HERE]):
            await until(lambda: caplog.messages)
    assert "it answers, but not as a Zenoh router" in caplog.messages[0]


def test_a_port_that_is_taken_is_told(router: Router) -> None:
    with pytest.raises(ConfigError, match="port 7447 is taken; does another router run already"):
        Router([HERE])


def test_an_address_of_another_computer_cannot_be_served() -> None:
    with pytest.raises(ConfigError, match=r"tcp/10\.1\.2\.3:7447: this computer does not have that address"):
        Router(["tcp/10.1.2.3:7447"])


async def test_without_the_library_one_sentence_says_what_to_do(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(__import__("sys").modules, "zenoh", None)
    with pytest.raises(ConfigError, match=r"not here: pip install 'msbot-agent\[zenoh\]'"):
        open_space(parse_space("zenoh"))


@pytest.fixture(autouse=True)
def _only_ours(caplog: pytest.LogCaptureFixture) -> None:
    caplog.set_level(logging.WARNING, "msbot")
