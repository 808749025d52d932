"""Packets in words, with the messages on the topics."""

from __future__ import annotations

from struct import pack, unpack

import pytest
from hypothesis import given
from hypothesis import strategies as st

from msbot.part import HelloWorld
from msbot.part.calls import ReplyStatus, encode_reply
from msbot.part.join import thesis_messages
from msbot.part.join.pnp_messages import (
    INVENTORY_REPLY_TOPIC,
    INVENTORY_REPLY_TYPE,
    INVENTORY_REQUEST_TOPIC,
    INVENTORY_REQUEST_TYPE,
    INVENTORY_SERVICE,
    PROFILE_TOPIC,
    PROFILE_TYPE,
    Beat,
    BeatReply,
    BindingDirection,
    ConfigurationMessage,
    PortBinding,
    ProfileMessage,
)
from msbot.part.messages.standard import Level
from msbot.pnp import KnownObject, SessionListener
from msbot.pnp.explain_samples import MAX_JOINED, PacketWords, value_words
from msbot_xrce.messages import (
    STREAM_BEST_EFFORT,
    Create,
    CreateClient,
    Data,
    Format,
    Fragment,
    Header,
    ObjectVariant,
    Submessage,
    WriteData,
    encode_message,
)
from msbot_xrce.objects import (
    EndpointQos,
    participant_variant,
    reader_variant,
    replier_variant,
    requester_variant,
    subscriber_variant,
    topic_variant,
    writer_variant,
)

QOS = EndpointQos()
SAMPLE = HelloWorld(index=3, message="turn-on 2").encode()


def packet(*submessages: Submessage, sequence_nr: int = 0) -> bytes:
    return encode_message(Header(0x81, 0x80, sequence_nr), submessages, pad_end=False)


def service(name: str, objects: int = 0x0017) -> bytes:
    make = requester_variant if objects & 0xF == 7 else replier_variant
    variant = make(
        name, INVENTORY_REQUEST_TYPE, INVENTORY_REPLY_TYPE, INVENTORY_REQUEST_TOPIC, INVENTORY_REPLY_TOPIC, 0x11
    )
    return packet(Create(14, objects, variant))


def after(setup: bytes, *said: bytes, up: bool) -> list[str]:
    """What is noted below the submessages of the last packet."""
    listener = SessionListener()
    assert not notes(listener.explain(setup, 1, up=True))
    lines: list[str] = []
    for one in said:
        lines = listener.explain(one, 1, up=up)
    return notes(lines)


def notes(lines: list[str]) -> list[str]:
    return [line.strip() for line in lines if line.startswith(" ")]


RING = packet(
    Create(10, 0x0011, participant_variant("p", 0)),
    Create(11, 0x0012, topic_variant("HelloWorldTopic_1_to_2", "HelloWorld", 0x11)),
    Create(12, 0x0022, topic_variant("Light", "LightLevel", 0x11)),
    Create(13, 0x0014, subscriber_variant(0x11)),
    Create(14, 0x0015, writer_variant(0x12, 0x13, QOS)),
    Create(15, 0x0016, reader_variant(0x12, 0x14, QOS)),
    Create(16, 0x0025, writer_variant(0x22, 0x13, QOS)),
    Create(17, 0x0035, writer_variant(0x92, 0x13, QOS)),
)


@pytest.mark.parametrize(
    ("submessage", "note"),
    [
        (WriteData(20, 0x0015, SAMPLE), "HelloWorldTopic_1_to_2: HelloWorld(index=3, message='turn-on 2')"),
        (Data(20, 0x0016, SAMPLE), "HelloWorldTopic_1_to_2: HelloWorld(index=3, message='turn-on 2')"),
        (WriteData(20, 0x0025, b"\1\2\3\4"), "Light: a LightLevel"),
        (WriteData(20, 0x0035, b"\1\2\3\4"), "unknown topic: a message"),
        (WriteData(20, 0x0015, b"\1"), "HelloWorldTopic_1_to_2: makes no sense: "),
    ],
)
def test_samples_are_shown_with_their_topic(submessage: Submessage, note: str) -> None:
    (shown,) = after(RING, packet(submessage), up=isinstance(submessage, WriteData))
    assert shown.startswith(note)


def test_samples_of_unknown_objects_get_no_note() -> None:
    assert after(RING, packet(WriteData(20, 0x0095, SAMPLE)), up=True) == []


def test_topics_by_xml_are_known_too() -> None:
    xml = (
        "<dds><data_reader><topic><kind>NO_KEY</kind><name>msbot_masterTopic</name>"
        "<dataType>HelloWorld</dataType></topic></data_reader></dds>"
    )
    setup = packet(Create(10, 0x0016, ObjectVariant(6, Format.XML, xml, None, 0x14, 0)))
    assert after(setup, packet(Data(20, 0x0016, SAMPLE)), up=False) == [
        f"{PROFILE_TOPIC}: HelloWorld(index=3, message='turn-on 2')"
    ]
    assert PROFILE_TYPE == "msbot_master"


@pytest.mark.parametrize(
    ("object_id", "submessage", "note"),
    [
        (0x0017, WriteData(20, 0x0017, Beat(lease=7).encode()), "request of msbot_inventory: Beat(lease=7)"),
        (
            0x0017,
            Data(20, 0x0017, b"\0\x14\0\x17" + BeatReply(configuration_version=2).encode()),
            "reply of msbot_inventory: BeatReply(configuration_version=2)",
        ),
        (0x0018, Data(20, 0x0018, bytes(24) + Beat(lease=7).encode()), "request of msbot_inventory: Beat(lease=7)"),
        (
            0x0018,
            WriteData(20, 0x0018, bytes(24) + BeatReply(configuration_version=2).encode()),
            "reply of msbot_inventory: BeatReply(configuration_version=2)",
        ),
        (0x0017, WriteData(20, 0x0017, b"\1"), "request of msbot_inventory: makes no sense: "),
    ],
)
def test_the_inventory_service_is_understood(object_id: int, submessage: Submessage, note: str) -> None:
    (shown,) = after(service(INVENTORY_SERVICE, object_id), packet(submessage), up=isinstance(submessage, WriteData))
    assert shown.startswith(note)


def test_the_thesis_own_service_is_understood() -> None:
    setup = service(thesis_messages.SERVICE)
    (request,) = after(setup, packet(WriteData(20, 0x0017, thesis_messages.encode_request("ABCD", "AA"))), up=True)
    assert request.startswith("request of service_name: Claim(part_number='ABCD', local_name='AA'")
    (reply,) = after(setup, packet(Data(20, 0x0017, bytes(4) + thesis_messages.encode_reply("ABCD"))), up=False)
    assert reply == "reply of service_name: ABCD"


def test_other_services_are_named() -> None:
    assert after(service("adder"), packet(WriteData(20, 0x0017, b"\1")), up=True) == [
        "request of adder: a msbot_inventory_request"
    ]


def pieces(whole: bytes) -> list[bytes]:
    return [
        packet(Fragment(whole[:20], last=False), sequence_nr=5),
        packet(Fragment(whole[20:40], last=False), sequence_nr=6),
        packet(Fragment(whole[40:], last=True), sequence_nr=7),
    ]


WHOLE = packet(WriteData(20, 0x0015, HelloWorld(index=3, message="a" * 40).encode()))[4:]


def test_fragments_are_joined() -> None:
    joined = after(RING, *pieces(WHOLE), up=True)
    assert joined[0].startswith("together: WRITE_DATA to datawriter 0x0015")
    assert joined[1].endswith(f"HelloWorld(index=3, message='{'a' * 40}')")


def test_a_repeated_fragment_does_no_harm_and_a_missing_one_is_no_message() -> None:
    one, two, three = pieces(WHOLE)
    assert len(after(RING, one, two, one, two, three, up=True)) == 2
    assert after(RING, one, three, up=True) == []
    assert len(after(RING, one, three, one, two, three, up=True)) == 2, "the next message is whole again"


def test_a_message_without_end_is_not_kept() -> None:
    endless = [packet(Fragment(bytes(60_000), last=False), sequence_nr=number) for number in range(30)]
    assert after(RING, *endless, packet(Fragment(b"", last=True), sequence_nr=30), up=True) == []


def test_a_new_session_knows_nothing_of_the_old_one() -> None:
    listener = SessionListener()
    listener.explain(RING, 1, up=True)
    login = encode_message(Header(0x80, 0, 0), [CreateClient(0xAABBCCDD, 0x81, 512)], pad_end=False)
    listener.explain(login, 1, up=True)
    assert notes(listener.explain(packet(WriteData(20, 0x0015, SAMPLE)), 1, up=True)) == []


def test_sessions_are_kept_apart() -> None:
    listener = SessionListener()
    listener.explain(RING, 1, up=True)
    assert notes(listener.explain(packet(WriteData(20, 0x0015, SAMPLE)), 2, up=True)) == []
    assert notes(listener.explain(packet(WriteData(20, 0x0015, SAMPLE)), 1, up=True)) != []


def test_an_object_that_cannot_be_read_is_forgotten() -> None:
    broken = packet(Create(18, 0x0015, ObjectVariant(5, Format.BINARY, None, b"\xff", 0x13, 0)))
    assert after(RING, broken, packet(WriteData(20, 0x0015, SAMPLE)), up=True) == []


@given(st.lists(st.binary(max_size=60), max_size=6), st.booleans())
def test_whatever_is_said_nothing_raises(said: list[bytes], up: bool) -> None:
    listener = SessionListener()
    listener.explain(RING, 1, up=True)
    for octets in said:
        listener.explain(octets, 1, up=up)
        listener.explain(b"\x81\x80\0\0" + octets, 1, up=up)


def test_a_session_that_began_before_anybody_listened_is_understood_by_what_the_master_knows() -> None:
    known = {
        0x15: KnownObject("dial", Level.type_name, "knob", "level"),
        0x26: KnownObject("light", Level.type_name, "lamp", "bright"),
    }
    listener = SessionListener(
        (Level,),
        know=lambda peer, object_id: known.get(object_id) if peer == 7 else None,
        units=lambda name: {"percent": "%"} if name == Level.type_name else {},
    )
    header = Header(0x81, STREAM_BEST_EFFORT, 1)

    def hear(submessage: Submessage, peer: int, *, up: bool) -> PacketWords:
        return listener.explain_packet(encode_message(header, [submessage], pad_end=False), peer, up=up)

    value = Level(percent=49.9).encode()
    heard = hear(WriteData(7, 0x15, value), 7, up=True)
    assert (heard.plain, heard.about) == (("knob says level 49.9 %",), ())
    assert any("dial: " in line for line in heard.protocol)
    assert hear(Data(7, 0x26, value), 7, up=False).plain == ("lamp hears bright 49.9 %",)
    unknown = hear(WriteData(7, 0x15, value), 8, up=True)
    assert unknown.plain == (), "nothing is known of that peer"
    assert unknown.about == ("node 8 says something on a topic that is not known here",)
    assert hear(WriteData(7, 0x15, b"x"), 7, up=True).plain == (), "nonsense is said in the protocol's words"


def test_a_session_that_was_heard_from_its_beginning_says_itself_whose_it_is() -> None:
    listener = SessionListener((Level,), units=lambda _: {"percent": "%"})
    bound = [
        PortBinding(port=port, topic="dial", topic_type=Level.type_name, direction=direction, reliable=0)
        for port, direction in (("level", BindingDirection.PUBLISH), ("echo", BindingDirection.SUBSCRIBE))
    ]
    told = ConfigurationMessage(version=1, slot="knob", bindings=bound, settings=[]).encode()
    endpoints = packet(
        Create(12, 0x0012, topic_variant("dial", Level.type_name, 0x11)),
        Create(14, 0x0015, writer_variant(0x12, 0x13, QOS)),
        Create(15, 0x0016, reader_variant(0x12, 0x14, QOS)),
    )
    value = Level(percent=49.9).encode()

    def said() -> list[str]:
        up = listener.explain_packet(packet(WriteData(20, 0x0015, value)), 1, up=True).plain
        return [*up, *listener.explain_packet(packet(Data(20, 0x0016, value)), 1, up=False).plain]

    listener.explain_packet(service(INVENTORY_SERVICE), 1, up=True)
    listener.explain_packet(endpoints, 1, up=True)
    assert said() == [], "nobody was told whose these topics are"
    listener.explain_packet(packet(Data(20, 0x0017, bytes(4) + told[:-3])), 1, up=False)
    assert said() == [], "nonsense tells nothing"
    listener.explain_packet(packet(Data(20, 0x0017, bytes(4) + told)), 1, up=False)
    assert said() == ["knob says level 49.9 %", "knob hears echo 49.9 %"]
    login = encode_message(Header(0x80, 0, 0), [CreateClient(0xAABBCCDD, 0x81, 512)], pad_end=False)
    listener.explain_packet(login, 1, up=True)
    listener.explain_packet(endpoints, 1, up=True)
    assert said() == [], "another session may be another part's"


@pytest.mark.parametrize(
    ("value", "words"),
    [
        (unpack("<f", pack("<f", 49.9))[0], "49.9"),
        (0.1, "0.1"),
        (1 / 3, "0.333333333333333"),
        (unpack("<f", pack("<f", 1 / 3))[0], "0.3333333"),
        (float("inf"), "inf"),
        (1e300, "1e+300"),
        (5e38, "5e+38"),
        (-5e38, "-5e+38"),
        (2.0**127, "1.701412e+38"),
        (True, "on"),
        (7, "7"),
        ([1.5, 2.0], "[1.5, 2]"),
    ],
)
def test_a_value_is_said_as_its_type_means_it(value: object, words: str) -> None:
    assert value_words(value) == words


MASTER, DOES, ALIVE = "the master tells", "what it does in this robot", "says that it is alive"
LOGIN = encode_message(Header(0x80, 0, 0), [CreateClient(0xAABBCCDD, 0x81, 512)], pad_end=False)


def test_a_conversation_from_its_beginning_packet_by_packet() -> None:
    listener = SessionListener((Level, ProfileMessage), units=lambda _: {"percent": "%"})
    assert listener.part_at(7) == "node 7", "it has not been heard"
    endpoints = packet(
        Create(12, 0x0012, topic_variant("dial", Level.type_name, 0x11)),
        Create(13, 0x0022, topic_variant(PROFILE_TOPIC, PROFILE_TYPE, 0x11)),
        Create(14, 0x0015, writer_variant(0x12, 0x13, QOS)),
        Create(15, 0x0026, reader_variant(0x22, 0x14, QOS)),
        Create(16, 0x0032, topic_variant("odd", "Odd", 0x11)),
        Create(17, 0x0035, writer_variant(0x32, 0x13, QOS)),
    )
    bound = [PortBinding(port="", topic="dial", topic_type=Level.type_name, direction=0, reliable=0)]
    told = ConfigurationMessage(version=1, slot="knob", bindings=bound, settings=[])
    profile = ProfileMessage(index=1, message="Robo", name="", id="", dof="", make="")
    beat = Beat(lease=7).encode()
    level = Level(percent=50.0).encode()
    whole = packet(WriteData(20, 0x0017, beat))[4:]
    unknown = "says something on a topic that is not known here"
    piece, to = "sends a piece of a long message", "a piece of a long message"

    def fragment(octets: bytes, number: int, *, last: bool = False) -> bytes:
        return packet(Fragment(octets, last=last), sequence_nr=number)

    steps: list[tuple[bool, bytes, str, str, str, int]] = [
        (True, packet(WriteData(20, 0x0015, level)), "", f"node 7 {unknown}", "node 7", 1),
        (True, LOGIN, "", "node 7 begins a conversation", "node 7", 1),
        (True, service(INVENTORY_SERVICE), "", "node 7 sets up what it says and hears", "node 7", 1),
        (True, endpoints, "", "node 7 sets up what it says and hears", "node 7", 1),
        (True, packet(WriteData(20, 0x0035, b"x")), "", "a Odd, which is not known here", "node 7", 1),
        (True, packet(WriteData(20, 0x0015, level)), "", f"node 7 {unknown}", "node 7", 1),
        (False, packet(Data(20, 0x0026, profile.encode())), "", "node 7 hears which robot this is: Robo", "node 7", 1),
        (False, packet(Data(20, 0x0017, bytes(4) + told.encode())), "", f"{MASTER} knob {DOES}", "knob", 1),
        (True, packet(WriteData(20, 0x0017, beat), WriteData(21, 0x0035, b"x")), "", f"knob {ALIVE}", "knob", 1),
        (True, packet(WriteData(20, 0x0017, beat), WriteData(20, 0x0015, level)), "knob says 50 %", "", "knob", 1),
        (True, fragment(whole[:9], 5), "", f"knob {piece}", "knob", 1),
        (False, fragment(whole[:9], 5), "", f"the master sends knob {to}", "knob", 1),
        (True, fragment(whole[9:], 6, last=True), "", f"knob {ALIVE}", "knob", 1),
        (False, fragment(whole[9:], 6), "", f"the master sends knob {to}", "knob", 1),
        (True, LOGIN, "", "node 7 begins a conversation", "node 7", 1),
        (True, fragment(whole[9:], 7, last=True), "", f"node 7 {piece}", "node 7", 1),
        (False, fragment(b"", 7, last=True), "", f"the master sends node 7 {to}", "node 7", 1),
        (True, packet(WriteData(20, 0x0017, beat)), "", f"node 7 {unknown}", "node 7", 2),
    ]
    for number, (up, octets, plain, about, part, count) in enumerate(steps):
        heard = listener.explain_packet(octets, 7, up=up)
        assert ("; ".join(heard.plain), "; ".join(heard.about)) == (plain, about), number
        assert (listener.part_at(7), listener.unknown) == (part, count), number


@pytest.mark.parametrize(("peer", "name"), [(7, "node 7"), (0, "a part"), ("10.0.0.1:9", "a part")])
def test_a_peer_of_whom_nothing_is_known_has_a_number_on_a_bus_only(peer: int | str, name: str) -> None:
    listener = SessionListener()
    assert listener.part_at(peer) == name
    assert (
        listener.explain_packet(packet(WriteData(20, 0x0015, SAMPLE)), peer, up=True)
        .about[0]
        .startswith(f"{name} says ")
    )
    assert listener.part_at(peer) == name


@pytest.mark.parametrize(
    ("object_id", "up", "payload", "plain", "about"),
    [
        (0x15, True, SAMPLE, ("knob says port index 3, message turn-on 2",), ()),
        (0x16, False, SAMPLE, ("knob hears port index 3, message turn-on 2",), ()),
        (0x17, True, Beat(lease=7).encode(), (), ("knob says that it is alive",)),
        (
            0x17,
            False,
            bytes(4) + BeatReply(configuration_version=1).encode(),
            (),
            ("the master has heard that knob is alive",),
        ),
        (0x18, False, bytes(24) + Beat(lease=7).encode(), (), ("knob says that it is alive",)),
        (
            0x18,
            True,
            bytes(24) + BeatReply(configuration_version=0).encode(),
            (),
            ("the master does not know knob any more",),
        ),
    ],
)
def test_who_listens_late_understands_every_kind_of_object(
    object_id: int, up: bool, payload: bytes, plain: tuple[str, ...], about: tuple[str, ...]
) -> None:
    def know(_peer: object, which: int) -> KnownObject:
        if which & 0xF in (7, 8):
            return KnownObject(f"{INVENTORY_SERVICE}_Request", slot="knob")
        return KnownObject("dial", "HelloWorld", "knob", "port")

    listener = SessionListener(know=know)
    kind = WriteData if up else Data
    heard = listener.explain_packet(packet(kind(20, object_id, payload)), 7, up=up)
    assert (heard.plain, heard.about) == (plain, about)
    assert (listener.part_at(7), listener.unknown) == ("knob", 0)


@pytest.mark.parametrize(
    ("ahead", "is_whole"), [(0, False), (1, False), (0x7FFF, False), (0x8000, True), (0xFFFF, True)]
)
@pytest.mark.parametrize("up", [True, False])
def test_a_piece_from_the_half_circle_behind_is_a_repetition_and_one_from_ahead_means_a_loss(
    ahead: int, is_whole: bool, up: bool
) -> None:
    odd = packet(Fragment(b"x", last=False), sequence_nr=(6 + ahead) & 0xFFFF)
    first = packet(Fragment(WHOLE[:20], last=False), sequence_nr=5)
    rest = packet(Fragment(WHOLE[20:], last=True), sequence_nr=6)
    shown = after(RING, first, odd, rest, up=up)
    assert any(line.endswith(f"HelloWorld(index=3, message='{'a' * 40}')") for line in shown) is is_whole


@pytest.mark.parametrize("more", [0, 1])
def test_so_much_of_a_message_is_kept_and_not_an_octet_more(more: int) -> None:
    sizes = [60_000] * (MAX_JOINED // 60_000)
    sizes.append(MAX_JOINED - sum(sizes) + more)
    sent = [packet(Fragment(bytes(size), last=False), sequence_nr=number) for number, size in enumerate(sizes)]
    shown = after(RING, *sent, packet(Fragment(b"", last=True), sequence_nr=len(sizes)), up=True)
    assert bool(shown) is not bool(more)


def between_parts(objects: int) -> bytes:
    make = requester_variant if objects & 0xF == 7 else replier_variant
    return packet(Create(14, objects, make("tell", "HelloWorld", "HelloWorld", "tell_Request", "tell_Reply", 0x11)))


SHOWN = "HelloWorld(index=3, message='turn-on 2')"


@pytest.mark.parametrize(
    ("submessage", "note"),
    [
        (WriteData(20, 0x0017, SAMPLE), f"request of tell: {SHOWN}"),
        (Data(20, 0x0017, bytes(4) + encode_reply(ReplyStatus.DONE, SAMPLE)), f"reply of tell: {SHOWN}"),
        (
            Data(20, 0x0017, bytes(4) + encode_reply(ReplyStatus.REFUSED, "not now")),
            "reply of tell: no reply: refused: not now",
        ),
        (Data(20, 0x0018, bytes(24) + SAMPLE), f"request of tell: {SHOWN}"),
        (WriteData(20, 0x0018, bytes(24) + encode_reply(ReplyStatus.DONE, SAMPLE)), f"reply of tell: {SHOWN}"),
        (WriteData(20, 0x0018, bytes(24) + b"\xee"), "reply of tell: makes no sense: a reply with status 238"),
    ],
)
def test_requests_and_replies_between_parts_are_shown(submessage: WriteData | Data, note: str) -> None:
    setup = between_parts(submessage.object_id)
    (shown,) = after(setup, packet(submessage), up=isinstance(submessage, WriteData))
    assert shown.startswith(note)
