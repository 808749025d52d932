"""Every other parser of text and octets: read, or refused in words that a person can read; nothing else comes out."""

from __future__ import annotations

import io
import json
from collections.abc import Callable, Iterable, Mapping
from functools import cache
from pathlib import Path
from random import Random
from typing import TypeVar

import click

from fuzz.case import Case, Step, Violation, plain
from fuzz.mutate import mutate_octets
from fuzz.targets.own_files import OWN
from fuzz.targets.parser import Parser, file_of, lines
from msbot.cli.bus.dump import FilterType
from msbot.cli.bus.frame_log import FrameReader
from msbot.config import Library, load_library
from msbot.config.library.description_reader import read_description
from msbot.config.library.picture import picture_fault
from msbot.operations.part_names import uid_of
from msbot.operations.rights import Role
from msbot.part.join.part_keys import parse_key
from msbot.part.join.seal import Seal
from msbot.part.messages.standard import STANDARD_MESSAGES
from msbot.recording.recorder.batch import read_wish
from msbot.recording.recordings.mcap_reader import Decoder, RecordingReader
from msbot.recording.replay.recorded_operations import read_operations
from msbot.registry import ProgramSource
from msbot.ros2.forms import RosForm, form_of
from msbot.sim.arena import world_messages
from msbot.sim.arena.world_reader import parse_world
from msbot.stop.stop_request import answer_in
from msbot_agent.explain.datagrams import read_capture
from msbot_agent.idl.definitions_reader import common_ros_definitions
from msbot_agent.idl.model import Definitions
from msbot_agent.idl.omg_reader import read_idl
from msbot_agent.idl.ros_reader import read_ros
from msbot_agent.link.can.can_address import parse_target
from msbot_agent.link.can.protocol import format_log_line, parse_log_line
from msbot_agent.link.can.protocol.notation import format_frame, parse_frame
from msbot_agent.link.link_schemes import parse_host_and_port, parse_options
from msbot_agent.link.relay import relay_messages as relay
from msbot_agent.ros import discovery_info
from msbot_agent.space.space_address import check_endpoint, parse_space
from msbot_agent.space.zenoh.key_expressions import endpoint_of, token_key
from msbot_agent.wide.router_file import read_router_file
from msbot_school.classroom.mdns import parse_announcement
from msbot_school.faults.fault_kinds import read_condition
from msbot_school.lessons.conditions import read_lesson_condition
from msbot_school.lessons.lesson_reader import read_lesson
from msbot_school.missions.mission_file import parse_mission
from msbot_school.missions.recorded_missions import played_in
from msbot_web.access.class_list import new_accounts
from msbot_web.access.guest_tickets import GuestTickets
from msbot_web.programs.programs import check_program
from msbot_web.programs.robot_words import view_of, with_view
from msbot_xrce.errors import ConfigError, LocalProtocolError, MsbotError

ROOT = Path(__file__).parent.parent.parent
_T = TypeVar("_T")

PIECES = (
    b"\0", b"\x1b[31m", b"\xff", "ä".encode(), "\u0661".encode(), "\u2028".encode(), b"\\ud800", b"9" * 5000, b"1e999",
    b"NaN", b"-Infinity", b"[" * 3000, b"{\"a\":" * 800, b"null", b"true", b"-1", b"1.5", b"[]", b"{}", b"\"\"", b"=",
    b"[[", b"]]", b"\r\n", b":", b"/", b"#", b"%", b"..", b"0x", b"18446744073709551616", b"'", b"`", b"(", b")", b"<",
)  # fmt: skip
"""What parsers stumble on."""


class ParserTarget:
    """See the module's docstring.

    Args:
        only: one parser; empty: all.
    """

    name = "parsers"
    about = "all other parsers: read, or refused in printable words"

    def __init__(self, only: str = "") -> None:
        self._names = (only,) if only else tuple(PARSERS)

    def make(self, random: Random) -> Case:
        """A sample, changed."""
        name = random.choice(self._names)
        samples = samples_of(name)
        octets = random.choice(samples)
        if random.random() < 0.9:
            octets = mutate_octets(random, octets, (*samples[:20], *PIECES))
        if random.random() < 0.3:
            at = random.randrange(len(octets) + 1)
            octets = octets[:at] + random.choice(PIECES) + octets[at + random.choice((0, 0, 1, 4)) :]
        return (Step(name, octets),)

    def run(self, case: Case) -> Iterable[str]:
        """Read."""
        seen: set[str] = set()
        for step in case:
            if step.verb in PARSERS:
                seen.update(f"{step.verb}: {words}" for words in read(step.verb, step.data))
        return seen


def read(name: str, octets: bytes) -> Iterable[str]:
    """Read octets with one parser.

    Raises:
        Violation: what it said is nothing for a terminal. Whatever else comes out is wrong as well.
    """
    try:
        return set(PARSERS[name].read(octets))
    except MsbotError as error:
        words = str(error)
    if not words.strip():
        raise Violation("it is refused without a word")
    if not all(letter.isprintable() or letter == "\n" for letter in words):
        raise Violation(f"it is refused with {words!a:.300}")
    return {plain(words.replace("fuzz", ""), 45)}


@cache
def samples_of(name: str) -> tuple[bytes, ...]:
    """What is right, for one parser."""
    return tuple(PARSERS[name].samples())


# What the parsers need.


@cache
def _library() -> Library:
    return load_library()


def _text(octets: bytes) -> str:
    return octets.decode("utf-8", "replace")


def _files(pattern: str) -> Callable[[], Iterable[bytes]]:
    return lambda: [path.read_bytes() for path in sorted(ROOT.glob(pattern))]


def _words(function: Callable[[str], object]) -> Callable[[bytes], Iterable[str]]:
    """A parser of a text that gives anything."""

    def read_words(octets: bytes) -> Iterable[str]:
        return (type(function(_text(octets))).__name__,)

    return read_words


def _same(first: _T, again: _T, octets: bytes) -> None:
    if first != again and repr(first) != repr(again):  # a NaN is not like itself
        raise Violation(f"{octets!r:.200} is {first!r:.300}, and {again!r:.300} when written and read")


# The parsers.


def _frame(octets: bytes) -> Iterable[str]:
    frame = parse_frame(_text(octets))
    _same(frame, parse_frame(format_frame(frame)), octets)
    return (f"fd {frame.fd}, extended {frame.extended}, {len(frame.data)}",)


def _candump(octets: bytes) -> Iterable[str]:
    line = parse_log_line(_text(octets))
    _same(line.frame, parse_log_line(format_log_line(line)).frame, octets)
    return (f"at {line.at is None}",)


def _filter(octets: bytes) -> Iterable[str]:
    try:
        return (str(len(FilterType().convert(_text(octets), None, None))),)
    except click.UsageError as error:
        raise ConfigError(str(error)) from None


def _frame_log(suffix: str) -> Callable[[bytes], Iterable[str]]:
    def read_log(octets: bytes) -> Iterable[str]:
        reader = FrameReader()
        count = sum(1 for _ in reader.read(str(file_of(octets, suffix))))
        return (f"{min(count, 5)} frames", plain(reader.first_problem, 30))

    return read_log


def _foreign_logs(suffix: str) -> Callable[[], Iterable[bytes]]:
    """Logs as python-can writes them."""

    def write() -> Iterable[bytes]:
        import can

        path = file_of(b"", suffix)
        with can.Logger(path) as logger:
            for number in range(4):
                logger(
                    can.Message(
                        timestamp=1.5 + number,
                        arbitration_id=number + 0x100,
                        data=bytes(2 * number),
                        is_extended_id=number == 2,
                        is_fd=number == 3,
                        channel=0,
                    )
                )
        return [path.read_bytes()]

    return write


def _capture(octets: bytes) -> Iterable[str]:
    return [type(found).__name__ for found in read_capture(file_of(octets, ".pcap"))][:20]


def _captures() -> Iterable[bytes]:
    import dpkt

    for link_type, packet in (
        (1, _ethernet()),
        (101, _ethernet()[14:]),
        (227, bytes.fromhex("0000012304000000deadbeef")),
    ):
        for make in (dpkt.pcap.Writer, dpkt.pcapng.Writer):
            stream = io.BytesIO()
            if make is dpkt.pcap.Writer:
                writer = make(stream, linktype=link_type)
            else:
                writer = make(stream, idb=dpkt.pcapng.InterfaceDescriptionBlockLE(linktype=link_type))
            writer.writepkt(packet, ts=1.0)
            writer.writepkt(packet, ts=2.0)
            yield stream.getvalue()


def _ethernet() -> bytes:
    import dpkt

    udp = dpkt.udp.UDP(sport=1024, dport=8888, data=bytes.fromhex("8000000000010f00"))
    udp.ulen = len(udp)
    packet = dpkt.ip.IP(src=bytes((127, 0, 0, 1)), dst=bytes((10, 0, 0, 2)), p=17, data=udp)
    packet.len = len(packet)
    return bytes(dpkt.ethernet.Ethernet(src=bytes(6), dst=bytes(6), data=packet))


def _recording(octets: bytes) -> Iterable[str]:
    path = file_of(octets, ".mcap")
    reader, decoder = RecordingReader(path), Decoder()
    for message in reader.messages():
        yield f"{message.topic[:20]} {decoder.fields(message) is None}"
    yield plain(reader.damage, 30)
    yield type(played_in(RecordingReader(path))).__name__
    yield type(read_operations(path)).__name__


def _recordings() -> Iterable[bytes]:
    from mcap.writer import CompressionType, Writer

    for compression in (CompressionType.NONE, CompressionType.LZ4, CompressionType.ZSTD):
        stream = io.BytesIO()
        writer = Writer(stream, compression=compression, chunk_size=300)
        writer.start("ros2", "msbot")
        schema = writer.register_schema("std_msgs/msg/Float32", "ros2msg", b"float32 data\nstring[] names")
        plain_one = writer.register_schema("msbot/act", "jsonschema", b"{}")
        topics = ("/msbot/events", "/msbot/acts", "/msbot/mission", "/msbot/slots")
        channels = [writer.register_channel(topic, "json", plain_one) for topic in topics]
        channels.append(writer.register_channel("/light", "cdr", schema, {"slot": "S0"}))
        for number in range(8):
            cdr = bytes.fromhex("000100000000803f01000000020000006100")
            note = {
                "slot": "S0",
                "word": "x",
                "who": "ada",
                "operation": "stop",
                "arguments": {"a": 1},
                "began_ms": 5,
                "at_s": number,
                "what": "act",
                "number": 1,
                "text": None,
                "head": {"number": 1, "mission": "fuzz", "toml": _mission(), "seed": 1, "began_ms": 5},
            }
            for channel in channels:
                data = cdr if channel == channels[-1] else json.dumps(note).encode()
                writer.add_message(channel, number * 10**9, data, number * 10**9)
        writer.finish()  # type: ignore[no-untyped-call]
        yield stream.getvalue()


def _mission() -> str:
    return (ROOT / "packages/msbot-school/src/msbot_school/missions/ready/echo.toml").read_text("utf-8")


def _idl(octets: bytes) -> Iterable[str]:
    found = Definitions()
    read_idl(_text(octets), "fuzz.idl", found)
    return (f"{len(vars(found)) if hasattr(found, '__dict__') else 0}",)


_ROS = """\
# A comment
uint8 A=1
string NAME = "x # y"
int32[] numbers
float64[3] fixed
string<=5 word "default"
bool[<=2] flags [True, False]
builtin_interfaces/Time stamp
"""


def _ros(octets: bytes) -> Iterable[str]:
    known = common_ros_definitions()

    def find(*_: object) -> None:
        return None

    read_ros(_text(octets), "fuzz.msg", ("fuzz", "msg", "Fuzz"), known, find)
    return ("read",)


def _arena(octets: bytes) -> Iterable[str]:
    said = world_messages.from_line(octets)
    if said is None:
        return ("nothing",)
    for key, value in said.items():
        world_messages.is_name(key)
        world_messages.is_name(value)
        world_messages.known_quantities(value)
        values = world_messages.values_of(value)
        world_messages.to_line({"see": values})
    return (f"{len(said)} keys",)


def _relay(octets: bytes) -> Iterable[str]:
    message = relay.decode(octets)
    try:
        written = relay.encode(message)
    except LocalProtocolError as error:
        raise Violation(f"{message!r:.200} was read, but cannot be written: {error}") from error
    again = relay.decode(
        written
    )  # words that are no UTF-8 have become others, and may be shorter: from then on the same
    _same(again, relay.decode(relay.encode(again)), octets)
    return (type(message).__name__,)


def _relays() -> Iterable[bytes]:
    boot = bytes(relay.BOOT_SIZE)
    said: list[relay.Message] = [
        relay.Hello(boot, "left", "can", 64, 500_000, True, False),
        relay.Up(3, "node 3", b"abc"),
        relay.RelayBeat(1, 2, "why", (relay.Event(3, relay.RelayEventKind.CAME, "node 3"),)),
        relay.Room(((1, 2), (3, 4))),
        relay.Bye(),
        relay.Welcome(boot, 5, 6),
        relay.Down(3, 4, b"abc"),
        relay.Heard(1, 2, 3, 4),
        relay.Who(),
        relay.Refused("no"),
    ]
    return [relay.encode(one) for one in said]


def _nodes(octets: bytes) -> Iterable[str]:
    size = discovery_info.gid_octets_of(octets)
    if size is None:
        discovery_info.decode(octets, discovery_info.SINCE_IRON)
        return ("either",)
    participant, nodes = discovery_info.decode(octets, size)
    _same(nodes, discovery_info.decode(discovery_info.encode(participant, nodes, size), size)[1], octets)
    return (f"{size}, {min(len(nodes), 3)} nodes",)


def _node_samples() -> Iterable[bytes]:
    from msbot_agent.ros.node_names import NodeName

    nodes = [discovery_info.NodeInfo(NodeName("/rover", "eyes"), (bytes(16),), (bytes(16), bytes(range(16))))]
    return [discovery_info.encode(bytes(16), nodes, size) for size in (16, 24)]


def _ros_form(octets: bytes) -> Iterable[str]:
    for name, form in _forms().items():
        for way in (form.outward, form.inward):
            try:
                way(octets)
            except MsbotError as error:
                yield f"{name} {plain(str(error), 20)}"
            else:
                yield f"{name} read"


@cache
def _forms() -> dict[str, RosForm]:
    found: dict[str, RosForm] = {}
    for one in STANDARD_MESSAGES.values():
        try:
            found[one.__name__] = form_of(one)
        except ConfigError:
            continue
    return found


def _description(octets: bytes) -> Iterable[str]:
    described = read_description(_text(octets), "FUZZ", _library())
    again = read_description(described.toml, "FUZZ", _library())
    _same(described.part_type, again.part_type, octets)
    return (f"{len(described.part_type.ports)} ports",)


_DESCRIPTION = """\
number = "FUZZ"
name = "Described"
category = "sensor"

[[port]]
name = "out"
direction = "publish"
type = "Own"
rate_hz = 5

[[parameter]]
name = "gain"
type = "float"
default = 1.5
minimum = 0
maximum = 10

[[type]]
name = "Own"
fields = [{ name = "level", type = "float32" }]
"""


def _picture(octets: bytes) -> Iterable[str]:
    return (plain(picture_fault(_text(octets)) or "good", 30),)


def _blocks(octets: bytes) -> Iterable[str]:
    text = _text(octets)
    for view in ("blocks", "python"):
        shown = with_view(text, view)
        if shown != text and view_of(shown) != view:
            raise Violation(f"{shown:.100} is not shown as {view}")
    check_program("fuzz.py", ProgramSource("x = 1", text))
    return (view_of(text),)


def _seal(octets: bytes) -> Iterable[str]:
    seal = Seal(bytes(32), is_part=False)
    if seal.open(3, octets) is not None and octets not in samples_of("seal"):
        raise Violation(f"{octets.hex()} has a seal that nobody made")
    return (seal.reason or "opened",)


def _seals() -> Iterable[bytes]:
    part = Seal(bytes(32), is_part=True)
    return [part.seal(3, sample) for sample in (b"", b"\1\2\3", bytes(60))]


def _stop_answer(octets: bytes) -> Iterable[str]:
    return (str(answer_in(octets, "word") is None),)


def _mdns(octets: bytes) -> Iterable[str]:
    names = (b"robot", b"serial", b"version", b"class", b"tls")
    texts: Mapping[bytes, bytes | None] = dict(zip(names, octets.split(b"|"), strict=False))
    for found in parse_announcement(texts, 8080, ["10.0.0.1", _text(octets)[:20]]):
        if not all(one.isprintable() for one in (found.robot, found.serial_number, found.version, found.class_name)):
            raise Violation(f"{found!r}")
        yield found.address[:8]


def _token(octets: bytes) -> Iterable[str]:
    text = _text(octets)
    found = endpoint_of(text)
    if found is not None:
        written = token_key(text.partition("/@graph")[0], found.guid, found.qos, writes=found.is_writer)
        yield f"{found.is_writer} {written.count('/')}"


def _people(octets: bytes) -> Iterable[str]:
    return (f"{min(len(new_accounts(octets, 'fuzz.csv', Role.STUDENT)), 4)} people",)


def _ticket(octets: bytes) -> Iterable[str]:
    tickets = GuestTickets(lambda: 0.0)
    for way in (tickets.find, tickets.admit, tickets.path_of):
        yield type(way(_text(octets))).__name__


def _address(octets: bytes) -> Iterable[str]:
    rest, options = parse_options(_text(octets), baud=1, node=0)
    host, port = parse_host_and_port(rest)
    return (f"{':' in host} {port.bit_length()} {len(options)}",)


PARSERS: dict[str, Parser] = OWN | {
    "world": Parser(
        _words(lambda text: parse_world(text, "fuzz.toml")), _files("packages/msbot/src/msbot/sim/arena/worlds/*.toml")
    ),
    "mission": Parser(
        _words(lambda text: parse_mission(text, "fuzz.toml")),
        _files("packages/msbot-school/src/msbot_school/missions/ready/*.toml"),
    ),
    "lesson": Parser(
        lambda octets: (f"{len(read_lesson(file_of(octets, '.md')).steps)} steps",), _files("lessons/*.md")
    ),
    "router": Parser(
        lambda octets: (type(read_router_file(file_of(octets, ".toml"))).__name__,),
        lines(
            'listen = ["tcp/0.0.0.0:7447"]\nconnect = ["tcp/10.0.0.1:7447"]\n[[allow]]\n'
            'interfaces = ["eth0"]\nwho = ["a"]\nkeys = ["ROVER/**"]\nmay = ["send"]\n'
        ),
    ),
    "people": Parser(_people, lines("name,role,password\nada,teacher,correct-horse-7\nbob,,\n", "a;b\n", "ada\nbob\n")),
    "description": Parser(_description, lines(_DESCRIPTION)),
    "picture": Parser(_picture, lines('<svg xmlns="http://www.w3.org/2000/svg"><g><path d="M0 0"/></g></svg>')),
    "blocks": Parser(_blocks, lines('{"blocks":{"blocks":[{"type":"a","fields":{"x":1.5}}]},"view":"blocks"}', "{}")),
    "wish": Parser(_words(read_wish), lines("10min", "2h", "30min,500MB", "off", "lesson.mcap", "1.5 GB")),
    "condition": Parser(_words(read_condition), lines("eyes is active", "eyes.distance < 0.5", "wheels.left >= -1e3")),
    "lesson_condition": Parser(
        _words(read_lesson_condition),
        lines(
            "eyes is active",
            "eyes.distance < 0.5",
            "not (stopped)",
            "eyes was lost",
            "a.out -> b.in",
            "eyes.gain = 5",
            "eyes.level spans 0.5",
            "eyes holds ABCD",
            "slot eyes exists",
        ),
    ),
    "space": Parser(_words(parse_space), lines("memory", "dds:3", "zenoh:tcp/127.0.0.1:7447", "zenoh", "dds:0?x=1")),
    "endpoint": Parser(_words(check_endpoint), lines("tcp/127.0.0.1:7447", "tls/a.b:1", "udp/[::1]:5")),
    "address": Parser(_address, lines("127.0.0.1:8888?baud=5", "[::1]:1", ":8888", "localhost:65535?node=1&baud=2")),
    "can_address": Parser(
        _words(parse_target), lines("can0", "vcan0?fd=1&bitrate=500000", "slcan@/dev/ttyUSB0?x=y", "sim:bus")
    ),
    "key": Parser(_words(parse_key), lines("00112233445566778899aabbccddeeff", "00:11", "abc")),
    "uid": Parser(_words(uid_of), lines("0011223344556677", "00:11:22:33:44:55:66:77", "eyes")),
    "frame": Parser(
        _frame,
        lines("123#DEADBEEF", "1ABCDEF0#11.22", "123#R4", "123#0011223344556677_F", "123##1DEAD", "20000004#00"),
    ),
    "candump": Parser(
        _candump,
        lines(
            "(1700000000.123456) can0 123#DEADBEEF",
            " (1700000000.123456)  can0  123   [4]  DE AD BE EF",
            " vcan0  RX - -  123  [02]  DE AD",
            "can0  123  {F} 00 11 22 33 44 55 66 77",
        ),
    ),
    "filter": Parser(_filter, lines("100:780", "7FF", "1ABCDEF0~1FFFFFFF", "node=3")),
    "log": Parser(_frame_log(".log"), lines("(1.5) can0 123#DEAD\n\n(1.6) can0 123##1AA\nnothing\n")),
    "asc": Parser(_frame_log(".asc"), _foreign_logs(".asc")),
    "trc": Parser(_frame_log(".trc"), _foreign_logs(".trc")),
    "csv": Parser(_frame_log(".csv"), _foreign_logs(".csv")),
    "blf": Parser(_frame_log(".blf"), _foreign_logs(".blf")),
    "capture": Parser(_capture, _captures),
    "recording": Parser(_recording, _recordings),
    "idl": Parser(
        _idl,
        lines(
            "module a { module msg { const long N = 2*(3+1); @final struct B { @key long x; sequence<string<5>, 3> y; "
            "octet z[N]; }; enum E { P, Q }; union U switch(long) { case 1: float f; }; typedef sequence<long> L; }; };"
        ),
    ),
    "ros": Parser(_ros, lines(_ROS, "string name\n---\nbool ok\n")),
    "arena": Parser(
        _arena,
        lines(
            '{"arena": 1, "password": "x", "robot": "second"}',
            '{"seat": "eyes", "can": ["distance", "motor.left"]}',
            '{"do": {"wheels": {"motor.left": 50, "motor.right": true}}}',
            '{"see": {"eyes": {"distance": 0.4}}}',
        ),
    ),
    "relay": Parser(_relay, _relays),
    "nodes": Parser(_nodes, _node_samples),
    "ros_form": Parser(_ros_form, lambda: [one().encode() for one in STANDARD_MESSAGES.values()]),
    "seal": Parser(_seal, _seals),
    "stop_answer": Parser(_stop_answer, lines('{"meant": true, "robot": "R", "stopped": true, "silent": []}')),
    "mdns": Parser(_mdns, lines("ROVER|1|0.1.0|7b|1", "R|||", "ROVER\x1b|1")),
    "token": Parser(_token, lines("R/0/light/Light/@graph/w/" + "00" * 16 + "/3/0.5")),
    "ticket": Parser(_ticket, lines("ABC-DEF", "abcdefghijkl")),
}
