"""The relay's state alone: turns, bounds, order, and whatever octets come."""

import contextlib

from hypothesis import given
from hypothesis import strategies as st

from msbot_agent.link import LinkInfo, Peer
from msbot_agent.link.relay.forwarder import (
    FULL_DOWN,
    FULL_UP,
    MOST_PARTS,
    QUEUE_PACKETS,
    STRANGE,
    Forwarder,
    ForwarderEvent,
    MasterBack,
    MasterSilent,
    StopSaid,
    Welcomed,
)
from msbot_agent.link.relay.relay_messages import (
    MARK,
    Bye,
    Down,
    Event,
    Heard,
    Hello,
    Message,
    Refused,
    RelayBeat,
    RelayEventKind,
    Room,
    Up,
    Welcome,
    Who,
    decode,
    encode,
)
from msbot_xrce.errors import RemoteProtocolError

BOOT = b"boot 123"


def forwarder(events: list[ForwarderEvent] | None = None) -> Forwarder:
    made = Forwarder(
        boot=BOOT,
        name="pi",
        carried=LinkInfo("can:can0", 4096, 500_000, shared_bus=True),
        describe=lambda peer: f"CAN node {peer}",
        on_event=(events if events is not None else []).append,
    )
    made.start(0.0)
    return made


def welcomed(stops: int = 0, events: list[ForwarderEvent] | None = None) -> Forwarder:
    made = forwarder(events)
    made.from_master(encode(Welcome(BOOT, 7, stops)), 0.0)
    drain(made)
    return made


def drain(made: Forwarder) -> list[Message]:
    """Everything for the master."""
    found = []
    while (packet := made.to_master()) is not None:
        found.append(decode(packet))
    return found


def anybody(_: Peer) -> bool:
    return True


def test_a_relay_says_what_its_parts_link_is_like() -> None:
    assert drain(forwarder()) == [Hello(BOOT, "pi", "can:can0", 4096, 500_000, shared_bus=True, compresses=False)]


def test_numbers_go_from_1_to_65535_and_begin_again() -> None:
    made = welcomed()
    made.from_part(b"first", 1)
    drain(made)
    made._latest_number, made._beats, made._stops_said = 65534, 65534, 65534
    for peer in (2, 3):
        made.from_part(b"x", peer)
        made.stop_heard("no", 0.0)
    said = drain(made)
    assert [message.number for message in said if isinstance(message, Up)] == [65535, 2], "1 is there still"
    beats = [message for message in said if isinstance(message, RelayBeat)]
    assert [beat.count for beat in beats] == [65535, 1, 2, 3, 4, 5]
    assert [beat.stops_said for beat in beats] == [65535] * 3 + [1] * 3


texts = st.text(st.characters(min_codepoint=32, max_codepoint=126), max_size=30)
numbers = st.integers(0, 65535)
messages = st.one_of(
    st.builds(Up, numbers, texts, st.binary(min_size=1, max_size=50)),
    st.builds(Down, numbers, numbers, st.binary(max_size=50)),
    st.builds(
        Hello,
        st.binary(min_size=8, max_size=8),
        texts.filter(bool),
        texts.filter(bool),
        st.integers(0, 2**32 - 1),
        st.integers(0, 2**32 - 1),
        st.booleans(),
        st.booleans(),
    ),
    st.builds(
        RelayBeat,
        numbers,
        numbers,
        texts,
        st.lists(st.builds(Event, numbers, st.sampled_from(RelayEventKind), texts), max_size=16).map(tuple),
    ),
    st.builds(Room, st.lists(st.tuples(numbers, numbers), max_size=100).map(tuple)),
    st.builds(Welcome, st.binary(min_size=8, max_size=8), st.integers(0, 2**32 - 1), numbers),
    st.builds(Heard, numbers, numbers, numbers, st.integers(0, 255)),
    st.builds(Refused, texts),
    st.just(Bye()),
    st.just(Who()),
)


@given(messages)
def test_every_message_is_read_as_it_was_written(message: Message) -> None:
    assert decode(encode(message)) == message


@given(st.one_of(st.binary(max_size=80), st.binary(max_size=80).map(lambda octets: MARK + octets)))
def test_any_octets_are_read_or_refused(octets: bytes) -> None:
    with contextlib.suppress(RemoteProtocolError):
        decode(octets)
    made = welcomed()
    made.from_master(octets, 1.0)
    made.from_part(b"still here", 1)
    assert b"still here" in [message.packet for message in drain(made) if isinstance(message, Up)]


def test_parts_take_turns_and_one_that_floods_fills_only_its_own_queue() -> None:
    made = welcomed()
    for _ in range(1000):
        made.from_part(b"flood", 1)
    made.from_part(b"calm", 2)
    assert made.dropped[FULL_UP] == 1000 - QUEUE_PACKETS
    packets = [message.packet for message in drain(made) if isinstance(message, Up)]
    assert packets[:3] == [b"flood", b"calm", b"flood"]
    assert len(packets) == QUEUE_PACKETS + 1


def test_stop_goes_before_all_that_waits_in_both_directions() -> None:
    events: list[ForwarderEvent] = []
    made = welcomed(events=events)
    for part in range(20):
        made.from_part(b"sample", part)
    made.stop_heard("STOP was pressed", 1.0)
    first = drain(made)[:3]
    assert [isinstance(message, RelayBeat) and message.stops_said for message in first] == [1, 1, 1]
    for count in range(5):
        made.from_master(encode(Down(1, count, b"move")), 1.0)
    events.clear()
    made.from_master(encode(Heard(0, 1, 1, 2)), 1.0)
    assert events == [StopSaid(2)]  # while five packets still wait
    assert made.to_part(anybody) is not None


def test_a_stop_that_is_confirmed_is_not_told_to_another_master() -> None:
    made = welcomed()
    made.stop_heard("STOP was pressed", 1.0)
    drain(made)
    made.from_master(encode(Heard(0, 1, 0, 0)), 1.0)
    made.from_master(encode(Who()), 2.0)  # a master that has just started
    made.from_master(encode(Welcome(BOOT, 7, 0)), 2.0)
    beats = [message for message in drain(made) if isinstance(message, RelayBeat)]
    assert [beat.stops_said for beat in beats] == [0]


def test_a_part_has_a_place_in_words_until_the_master_has_answered_it() -> None:
    made = welcomed()
    made.from_part(b"login", 5)
    made.from_part(b"login", 5)
    ups = [message for message in drain(made) if isinstance(message, Up)]
    assert [up.words for up in ups] == ["CAN node 5"] * 2
    made.from_master(encode(Down(ups[0].number, 1, b"yes")), 0.1)
    made.from_part(b"next", 5)
    assert [message.words for message in drain(made) if isinstance(message, Up)] == [""]


def test_a_master_that_is_new_to_the_relay_is_told_the_place_of_every_part_again() -> None:
    made = welcomed()
    made.from_part(b"login", 5)
    (up,) = [message for message in drain(made) if isinstance(message, Up)]
    made.from_master(encode(Down(up.number, 1, b"yes")), 0.1)
    made.from_master(encode(Welcome(BOOT, 7, 0)), 0.2)
    made.from_part(b"next", 5)
    assert [message.words for message in drain(made) if isinstance(message, Up)] == ["CAN node 5"]


def test_packets_for_a_part_wait_while_its_bus_is_full_and_are_reported_when_they_went() -> None:
    made = welcomed()
    for peer in (1, 2):
        made.from_part(b"login", peer)
    numbers = [message.number for message in drain(made) if isinstance(message, Up)]
    for count in range(QUEUE_PACKETS + 5):
        made.from_master(encode(Down(numbers[0], count, bytes((count,)))), 0.1)
    made.from_master(encode(Down(numbers[1], 9, b"other")), 0.1)
    assert made.dropped[FULL_DOWN] == 5
    assert made.to_part(lambda peer: peer == 2) == (2, b"other")
    assert made.to_part(lambda peer: peer == 2) is None
    assert made.to_part(anybody) == (1, b"\0")
    assert drain(made) == [Room(((numbers[1], 9), (numbers[0], 0)))]


def test_so_many_parts_and_the_one_that_was_silent_for_the_longest_makes_room() -> None:
    made = welcomed()
    for peer in range(MOST_PARTS + 10):
        made.from_part(b"login", peer)
    assert made.parts == MOST_PARTS
    assert len([message for message in drain(made) if isinstance(message, Up)]) == MOST_PARTS


def test_what_happened_is_repeated_until_the_master_has_confirmed_it() -> None:
    made = welcomed()
    made.part_event(3, RelayEventKind.CAME, "", 1.0)
    made.part_event(3, RelayEventKind.GONE, "pulled out", 1.1)
    made.handle_timer(10.0)
    beats = [message for message in drain(made) if isinstance(message, RelayBeat)]
    assert [len(beat.events) for beat in beats] == [1, 2, 2]
    assert beats[-1].events[1].words == "pulled out"
    made.from_master(encode(Heard(beats[0].count, 0, 0, 0)), 10.0)  # an old answer confirms nothing of the later
    made.from_master(encode(Heard(beats[-1].count, 0, 0, 0)), 10.0)
    made.handle_timer(20.0)
    assert [beat.events for beat in drain(made) if isinstance(beat, RelayBeat)] == [()]


def test_a_relay_asks_until_it_is_welcome_and_takes_no_welcome_of_another() -> None:
    events: list[ForwarderEvent] = []
    made = forwarder(events)
    assert [type(message) for message in drain(made)] == [Hello]
    made.from_master(encode(Welcome(b"somebody", 7, 0)), 0.1)
    assert not made.is_welcome
    assert made.dropped[STRANGE] == 1
    made.handle_timer(made.timer())
    assert [type(message) for message in drain(made)] == [Hello]
    made.from_master(encode(Welcome(BOOT, 7, 3)), 1.0)
    assert made.is_welcome
    assert events == [Welcomed(7)]  # the STOPs before its time are not repeated on its bus


def test_a_confirmation_that_comes_twice_confirms_nothing_that_happened_since() -> None:
    made = welcomed()
    made.part_event(3, RelayEventKind.CAME, "", 1.0)
    (beat,) = [message for message in drain(made) if isinstance(message, RelayBeat)]
    made.from_master(encode(Heard(beat.count, 0, 0, 0)), 1.0)
    made.part_event(3, RelayEventKind.GONE, "pulled out", 1.1)
    later = [message for message in drain(made) if isinstance(message, RelayBeat)]
    made.from_master(encode(Heard(beat.count, 0, 0, 0)), 1.2)
    made.handle_timer(20.0)
    told = [message for message in (*later, *drain(made)) if isinstance(message, RelayBeat)]
    assert [(one.what, one.words) for one in told[-1].events] == [(RelayEventKind.GONE, "pulled out")]


def test_all_that_waits_for_a_part_goes_to_it_in_order() -> None:
    made = welcomed()
    made.from_part(b"hello", 3)
    (up,) = [message for message in drain(made) if isinstance(message, Up)]
    for count, packet in enumerate((b"one", b"two", b"three")):
        made.from_master(encode(Down(up.number, count, packet)), 0.0)
    assert [made.to_part(anybody) for _ in range(4)] == [(3, b"one"), (3, b"two"), (3, b"three"), None]


def test_a_master_that_is_silent_is_told_once_and_how_long_it_was_when_it_is_back() -> None:
    events: list[ForwarderEvent] = []
    made = welcomed(events=events)
    events.clear()
    made.from_master(encode(Heard(0, 0, 0, 0)), 10.0)
    for now in (12.0, 12.1, 15.0):
        made.handle_timer(now)
    assert events == [MasterSilent(was_there=True)]
    made.from_master(encode(Heard(0, 0, 0, 0)), 17.5)
    made.from_master(encode(Heard(0, 0, 0, 0)), 18.0)
    assert events[1:] == [MasterBack(7.5)]
