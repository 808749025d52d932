"""What unmodified clients use beyond the list: descriptions in all forms, services, large samples, logging in again."""

from __future__ import annotations

import asyncio
import struct
from collections.abc import Awaitable, Callable

import pytest

from msbot.process.virtual_time import run_virtual
from msbot_agent.agent import Agent
from msbot_agent.space import MemorySpace
from msbot_xrce import ClientSessionSettings, References, Status
from msbot_xrce.messages import STREAM_RELIABLE, Format, LoginProperty, ObjectVariant
from msbot_xrce.objects import replier_variant
from tests.agent.wiring import WiredClient, serving
from tests.conformance.agent_rig import (
    AgentRig,
    acknack,
    create_client,
    data,
    fragment,
    hard_liveliness,
    heartbeat,
    octets,
    packets,
    participant,
    read,
    reliable,
    status,
    write,
)

Scenario = Callable[[WiredClient, WiredClient], Awaitable[None]]


def play(scenario: Scenario, references: References | None = None) -> None:
    """Run a scenario with two clients in open sessions, in virtual time."""

    async def main() -> None:
        async with serving(Agent(MemorySpace(), references=references)) as link:
            one, other = WiredClient(link, key=1), WiredClient(link, key=2)
            await one.connect()
            await other.connect()
            await scenario(one, other)

    run_virtual(main())


# Descriptions.

PARTICIPANT, TOPIC, PUBLISHER, SUBSCRIBER, WRITER, READER, REQUESTER, REPLIER = (
    0x0011, 0x0012, 0x0013, 0x0014, 0x0015, 0x0016, 0x0017, 0x0018
)  # fmt: skip
PARENTS = {PARTICIPANT: 0, WRITER: PUBLISHER, READER: SUBSCRIBER}


async def create(client: WiredClient, form: Format, texts: dict[int, str]) -> list[int]:
    """Create objects from texts, in that order; the statuses."""
    return [
        await client.create(
            object_id,
            ObjectVariant(object_id & 0xF, form, text, parent_id=PARENTS.get(object_id, PARTICIPANT)),
            reuse=False,
        )
        for object_id, text in texts.items()
    ]


HELLO_WORLD = {
    PARTICIPANT: "<dds><participant><rtps><name>default_xrce_participant</name></rtps></participant></dds>",
    TOPIC: "<dds><topic><name>HelloWorldTopic</name><dataType>HelloWorld</dataType></topic></dds>",
    PUBLISHER: "",
    SUBSCRIBER: "",
    WRITER: "<dds><data_writer><topic><kind>NO_KEY</kind><name>HelloWorldTopic</name><dataType>HelloWorld</dataType>"
            "</topic></data_writer></dds>",
    READER: "<dds><data_reader><topic><kind>NO_KEY</kind><name>HelloWorldTopic</name><dataType>HelloWorld</dataType>"
            "</topic></data_reader></dds>",
}  # fmt: skip
"""What eProsima's examples send."""

MICRO_ROS = {
    PARTICIPANT: "<dds><participant><rtps><name>node</name></rtps></participant></dds>",
    TOPIC: "<dds><topic><name>rt/chatter</name><dataType>std_msgs::msg::dds_::Int32_</dataType></topic></dds>",
    PUBLISHER: "<dds><publisher><name>p</name></publisher></dds>",
    SUBSCRIBER: "<dds><subscriber><name>s</name></subscriber></dds>",
    WRITER: "<dds><data_writer><historyMemoryPolicy>PREALLOCATED_WITH_REALLOC</historyMemoryPolicy><qos><reliability>"
            "<kind>RELIABLE</kind></reliability></qos><topic><kind>NO_KEY</kind><name>rt/chatter</name><dataType>"
            "std_msgs::msg::dds_::Int32_</dataType><historyQos><kind>KEEP_ALL</kind></historyQos></topic>"
            "</data_writer></dds>",
    READER: "<dds><data_reader><historyMemoryPolicy>PREALLOCATED_WITH_REALLOC</historyMemoryPolicy><qos><reliability>"
            "<kind>RELIABLE</kind></reliability></qos><topic><kind>NO_KEY</kind><name>rt/chatter</name><dataType>"
            "std_msgs::msg::dds_::Int32_</dataType><historyQos><kind>KEEP_ALL</kind></historyQos></topic>"
            "</data_reader></dds>",
}  # fmt: skip


@pytest.mark.parametrize("texts", [HELLO_WORLD, MICRO_ROS], ids=["HelloWorld", "micro-ROS"])
def test_objects_by_xml_carry_samples(texts: dict[int, str]) -> None:
    async def scenario(one: WiredClient, other: WiredClient) -> None:
        assert await create(one, Format.XML, texts) == [Status.OK] * 6
        assert await create(other, Format.XML, texts) == [Status.OK] * 6
        await other.read(READER, STREAM_RELIABLE)
        await one.write(WRITER, b"\1\0\0\0")
        assert other.received(READER) == [b"\1\0\0\0"]

    play(scenario)


FILE = """<profiles>
    <participant profile_name="default_xrce_participant">
        <rtps><name>default_xrce_participant</name></rtps></participant>
    <topic profile_name="shapetype_topic"><kind>WITH_KEY</kind><name>Square</name><dataType>ShapeType</dataType></topic>
    <data_writer profile_name="shapetype_data_writer"><topic><kind>WITH_KEY</kind><name>Square</name>
        <dataType>ShapeType</dataType></topic></data_writer>
    <data_reader profile_name="shapetype_data_reader"><topic><kind>WITH_KEY</kind><name>Square</name>
        <dataType>ShapeType</dataType></topic></data_reader>
    <requester profile_name="shapetype_requester" service_name="shapetype_service" request_type="request_type"
        reply_type="reply_type"></requester>
    <replier profile_name="shapetype_replier" service_name="shapetype_service" request_type="request_type"
        reply_type="reply_type"></replier>
</profiles>"""
SHAPES = {
    PARTICIPANT: "default_xrce_participant",
    TOPIC: "shapetype_topic",
    WRITER: "shapetype_data_writer",
    READER: "shapetype_data_reader",
    REQUESTER: "shapetype_requester",
    REPLIER: "shapetype_replier",
}


async def create_by_reference(client: WiredClient, names: dict[int, str]) -> list[int]:
    """Create objects from references, publisher and subscriber (which have none) from XML; the statuses."""
    names = dict(names)
    first = await create(client, Format.REFERENCE, {PARTICIPANT: names.pop(PARTICIPANT), TOPIC: names.pop(TOPIC)})
    await create(client, Format.XML, {PUBLISHER: "", SUBSCRIBER: ""})
    return first + await create(client, Format.REFERENCE, names)


def test_objects_by_reference_come_from_the_profile_file() -> None:
    async def scenario(one: WiredClient, other: WiredClient) -> None:
        assert await create_by_reference(one, SHAPES) == [Status.OK] * 6
        assert await create_by_reference(other, SHAPES) == [Status.OK] * 6
        await other.read(READER, STREAM_RELIABLE)
        await one.write(WRITER, b"square")
        assert other.received(READER) == [b"square"]
        await other.read(REPLIER, STREAM_RELIABLE)
        await one.write(REQUESTER, b"request")
        assert [request[24:] for request in other.received(REPLIER)] == [b"request"]
        assert await create(one, Format.REFERENCE, {TOPIC: "not in the file"}) == [Status.ERR_DDS_ERROR]

    play(scenario, References.parse(FILE, "agent.refs"))


def test_objects_by_reference_without_a_profile_file_are_named_after_their_topic() -> None:
    names = {PARTICIPANT: "any", TOPIC: "Square__t", WRITER: "Square__dw", READER: "Square__dr"}

    async def scenario(one: WiredClient, other: WiredClient) -> None:
        assert await create_by_reference(one, names) == [Status.OK] * 4
        assert await create_by_reference(other, names) == [Status.OK] * 4
        await other.read(READER, STREAM_RELIABLE)
        await one.write(WRITER, b"square")
        assert other.received(READER) == [b"square"]
        unknown = {TOPIC: "shapetype_topic", REQUESTER: "shapetype_requester"}
        assert await create(one, Format.REFERENCE, unknown) == [Status.ERR_DDS_ERROR] * 2

    play(scenario)


# Services.

ATTRIBUTES = ["profile_name=", "service_name=", "request_type=", "reply_type="]
VALUES = ["my_requester", "service_name", "request_type", "reply_type"]


@pytest.mark.parametrize("blank", [" ", ""], ids=["with blanks", "as the C examples send it"])
def test_services_by_the_xml_of_the_examples_and_of_the_thesis(blank: str) -> None:
    # The replier is called my_requester, too; without blanks this is no XML, and yet eProsima's examples send it.
    attributes = blank.join(f'{name}"{value}"' for name, value in zip(ATTRIBUTES, VALUES, strict=True))

    async def scenario(one: WiredClient, other: WiredClient) -> None:
        texts = {PARTICIPANT: HELLO_WORLD[PARTICIPANT], REQUESTER: f"<dds><requester {attributes}></requester></dds>"}
        assert await create(one, Format.XML, texts) == [Status.OK] * 2
        texts = {PARTICIPANT: HELLO_WORLD[PARTICIPANT], REPLIER: f"<dds><replier {attributes}></replier></dds>"}
        assert await create(other, Format.XML, texts) == [Status.OK] * 2
        await one.read(REQUESTER, STREAM_RELIABLE)
        await other.read(REPLIER, STREAM_RELIABLE)
        first = await one.write(REQUESTER, struct.pack("<II", 1, 2))
        second = await one.write(REQUESTER, struct.pack("<II", 3, 4))
        requests = other.received(REPLIER)
        assert [request[24:] for request in requests] == [struct.pack("<II", 1, 2), struct.pack("<II", 3, 4)]
        for request in reversed(requests):
            await other.write(REPLIER, request[:24] + struct.pack("<I", sum(struct.unpack("<II", request[24:]))))
        ids = {7: second, 3: first}
        assert one.received(REQUESTER) == [
            struct.pack(">HH", ids[total], REQUESTER) + struct.pack("<I", total) for total in (7, 3)
        ]
        await other.write(REPLIER, requests[0][:24] + b"again")
        assert one.received(REQUESTER) == []

    play(scenario)


def test_the_topics_of_a_service_may_be_named() -> None:
    names = "<request_topic_name>rq/addRequest</request_topic_name><reply_topic_name>rr/addReply</reply_topic_name>"
    by_xml = f'<dds><{{0}} profile_name="x" service_name="add" request_type="Q" reply_type="A">{names}</{{0}}></dds>'

    async def scenario(one: WiredClient, other: WiredClient) -> None:
        texts = {PARTICIPANT: HELLO_WORLD[PARTICIPANT], REQUESTER: by_xml.format("requester")}
        assert await create(one, Format.XML, texts) == [Status.OK] * 2
        await create(other, Format.XML, {PARTICIPANT: HELLO_WORLD[PARTICIPANT]})
        variant = replier_variant("add", "Q", "A", "rq/addRequest", "rr/addReply", PARTICIPANT)
        assert await other.create(REPLIER, variant) == Status.OK
        await other.read(REPLIER, STREAM_RELIABLE)
        await one.write(REQUESTER, b"?")
        assert [request[24:] for request in other.received(REPLIER)] == [b"?"]

    play(scenario)


# Large samples.


OURS = ClientSessionSettings(login_properties=((LoginProperty.NUMBER, "1"),))


@pytest.mark.parametrize("size", [65_531, 65_532, 100_000, 250_000])
@pytest.mark.parametrize("is_stock", [False, True])
def test_samples_beyond_64_kib_go_from_everybody_to_clients_of_ours_and_not_to_stock_ones(
    size: int, is_stock: bool, caplog: pytest.LogCaptureFixture
) -> None:
    sample = bytes(number * 7 & 0xFF for number in range(size))

    async def main() -> None:
        agent = Agent(MemorySpace())
        async with serving(agent) as link:
            one, other = WiredClient(link, key=1), WiredClient(link, key=2, settings=None if is_stock else OURS)
            await one.connect()
            await other.connect()
            writer, reader = await one.add_writer("picture"), await other.add_reader("picture")
            for _ in range(2):
                one.session.write(writer, sample, STREAM_RELIABLE)
                for _ in range(size // 500):
                    one.transmit()
                    await asyncio.sleep(0)
            is_for_it = size <= 65_531 or not is_stock
            assert other.received(reader) == [sample] * 2 * is_for_it
            await one.write(writer, b"and a small one")
            assert other.received(reader) == [b"and a small one"]
            dropped = agent.clients()[1].dropped
            assert dropped == ({} if is_for_it else {"sample too large for a stock client": 2})
            assert caplog.text.count("count in 16 bits") == (not is_for_it), "said once"

    run_virtual(main())


@pytest.mark.parametrize("size", [65_531, 65_532, 100_000])
def test_a_sample_in_the_pieces_of_a_c_client(agent: AgentRig, size: int) -> None:
    # Continuous fragments: WRITE_DATA of length 0, 500 octets a piece; DATA leaves the same way, as far as C clients
    # can count.
    agent.log_in()
    agent.set_up()
    agent.say(reliable(6, read()))
    sample = bytes(number * 11 & 0xFF for number in range(size))
    body = octets("07 01 00 00 00 40 00 15") + sample
    number, joined, expected = 7, b"", 6
    for start in range(0, len(body), 500):
        piece = body[start : start + 500]
        answers = agent.say(octets(reliable(number, fragment(piece.hex(), last=start + 500 >= len(body)))))
        number += 1
    while answers:
        for answer in map(bytes.fromhex, answers):
            if answer[1] == 0x80:
                assert answer[2] | answer[3] << 8 == expected
                assert len(answer) <= 508
                joined += answer[8:]
                expected += 1
        answers = agent.say(acknack(expected))
    assert joined == (octets("09 01 ff ff 00 21 00 16") + sample if size == 65_531 else b"")


def test_a_sample_larger_than_the_agent_joins_is_lost_and_counted() -> None:
    async def scenario(one: WiredClient, other: WiredClient) -> None:
        writer, reader = await one.add_writer("picture"), await other.add_reader("picture")
        one.session.write(writer, bytes(300_000), STREAM_RELIABLE)
        for _ in range(1000):
            one.transmit()
            await asyncio.sleep(0)
        await one.write(writer, b"small")
        assert other.received(reader) == [b"small"]

    play(scenario)


# Logging in again.


def rebooted(agent: AgentRig) -> None:
    """A client with a running read on 0x80 and two unacknowledged samples begins anew, as after a reboot."""
    agent.set_up_two()
    agent.say(reliable(6, read()))
    for number in (6, 7):
        agent.say(reliable(number, write(f"{number:02x}")), peer="writer")
    assert agent.take() == packets(reliable(6, data("06")), reliable(7, data("07")))
    agent.log_in()


def test_reads_go_on_with_numbers_from_0_after_logging_in_again(agent: AgentRig) -> None:
    rebooted(agent)
    assert agent.wait(1.0) == []
    agent.say(reliable(8, write("08")), peer="writer")
    assert agent.take() == packets(reliable(0, data("08")))
    assert agent.wait(0.25) == [(0.2, octets(heartbeat(0, 0)).hex())]


def test_objects_made_anew_end_their_reads(agent: AgentRig) -> None:
    rebooted(agent)
    assert agent.say(reliable(0, "01 05 11 00 00 0a 00 16 06 03 00 00 03 00 00 00 00 12 00 00 14 00 00 00")) == packets(
        status("81 80 00 00", "00 0a", "00 16"), acknack(1)
    )
    agent.say(reliable(8, write("08")), peer="writer")
    assert agent.take() == []
    assert agent.say(reliable(1, read(request="00 0b"))) == packets(
        reliable(1, data("08", request="00 0b")), acknack(2)
    )


def test_requests_of_before_are_answered_after_logging_in_again(agent: AgentRig) -> None:
    # A client that logs in again with its session keeps its objects, so also what it has asked.
    agent.log_in()
    agent.set_up()
    service = "02 00 00 00 73 00 00 00 02 00 00 00 51 00 00 00 02 00 00 00 41 00 00 00"
    for number, ids in enumerate(("00 10 00 17 07", "00 11 00 18 08"), start=6):
        created, _ = agent.say(reliable(number, f"01 01 26 00 {ids} 03 00 00 18 00 00 00 {service} 00 11 00 00"))
        assert created.endswith("0000")
    agent.say(reliable(8, read(request="00 12", object_id="00 17", stream="01")))
    agent.say(reliable(9, read(request="00 13", object_id="00 18", stream="01")))
    request, _ = agent.say(reliable(10, write("3f", request="00 14", object_id="00 17")))
    identity = request[24:72]
    agent.log_in()
    assert agent.say(reliable(0, write(identity + "21", request="00 0a", object_id="00 18"))) == packets(
        "81 01 00 00" + data("00 14 00 17 21", request="00 12", object_id="00 17"), acknack(1)
    )


@pytest.mark.parametrize("anew", ["reset", "login"])
def test_what_a_full_link_did_not_take_is_not_sent_into_the_new_streams(agent: AgentRig, anew: str) -> None:
    agent.set_up_two()
    agent.say(reliable(6, read()))
    agent.link.room = 1
    agent.inject(*(octets(reliable(number, write(f"{number:02x}"))) for number in (6, 7, 8)), peer="writer")
    agent.turn()
    assert agent.take() == packets(reliable(6, data("06")))
    agent.inject(octets("81 00 00 00 0c 01 00 00" if anew == "reset" else create_client()), peer="client")
    agent.turn()
    agent.make_room()
    assert [answer for answer in agent.take() if answer[2:4] == "80"] == []
    agent.say(reliable(9, write("09")), peer="writer")
    assert agent.take() == packets(reliable(0, data("09")))


def test_the_mtu_of_the_new_login_counts(agent: AgentRig) -> None:
    # The genuine agent goes on with the old one.
    agent.log_in()
    agent.set_up()
    agent.log_in(mtu="40 00")
    agent.say(reliable(0, read()))
    sizes = [len(octets(answer)) for answer in agent.say(reliable(1, write("11" * 100)))]
    assert sizes == [64, 60, 13]


def test_hard_liveliness_of_a_login_with_another_session_counts(agent: AgentRig) -> None:
    # The genuine agent forgets it.
    agent.log_in()
    agent.say(create_client(session="82", properties=hard_liveliness("000400")))
    assert [at for at, _ in agent.wait(0.9)] == [0.4, 0.6, 0.8]


def test_a_client_with_shared_memory_does_not_get_its_own_samples(agent: AgentRig) -> None:
    shared = "01 00 00 01 00 00 00 07 00 00 00 75 78 72 5f 73 6d 00 00 02 00 00 00 31 00"
    agent.say(create_client(properties=shared))
    agent.set_up()
    agent.say(reliable(6, read(stream="01")))
    assert agent.say(reliable(7, write("01"))) == packets(acknack(8))
    agent.log_in("aa bb cc ee", peer="writer")
    agent.set_up(peer="writer")
    agent.say(reliable(6, write("02")), peer="writer")
    assert agent.take() == packets("81 01 00 00" + data("02"))


def test_participants_of_other_domains_do_not_hear_each_other(agent: AgentRig) -> None:
    agent.set_up_two()
    agent.say(reliable(6, read(stream="01")))
    agent.say(participant(reliable(6, ""), flags="05", domain="07 00"), peer="writer")
    # Its topic and writer are still those of the old participant (no cascade), new ones are of the new.
    agent.say(reliable(7, write("01")), peer="writer")
    assert agent.take() == packets("81 01 00 00" + data("01"))
