"""Every decoder of DDS-XRCE: octets in, a value or RemoteProtocolError out; what was read is written alike."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from random import Random

from fuzz import grammar
from fuzz.case import Case, Step, Violation, plain
from fuzz.corpus import packets
from fuzz.mutate import mutate_octets
from msbot_agent.agent.discovery import discovery_answer
from msbot_agent.agent.reply_routing import decode_identity, encode_identity
from msbot_xrce import References, explain
from msbot_xrce.errors import ConfigError, RemoteProtocolError
from msbot_xrce.messages import CdrReader, Create, CreateClient, Header, Submessage, decode_header, iter_submessages
from msbot_xrce.objects import parse_variant
from msbot_xrce.objects.xml import MAX_DEPTH, Element, parse_xml


class CodecTarget:
    """See the module's docstring."""

    name = "codec"
    about = "the decoders of DDS-XRCE: RemoteProtocolError only, and decode(encode(x)) == x"

    def make(self, random: Random) -> Case:
        """Octets for one decoder."""
        which = random.choice(tuple(_DECODERS))
        return (Step(which, _octets(random, which)),)

    def run(self, case: Case) -> Iterable[str]:
        """Decode."""
        seen: set[str] = set()
        for step in case:
            decode = _DECODERS.get(step.verb)
            if decode is not None:
                try:
                    seen.update(f"{step.verb}: {words}" for words in decode(step.data))
                except (RemoteProtocolError, ConfigError) as error:
                    if isinstance(error, ConfigError) and step.verb != "profiles":
                        raise
                    seen.add(f"{step.verb}: {plain(str(error))}")
        return seen


def _octets(random: Random, which: str) -> bytes:
    if random.random() < 0.05:
        return random.randbytes(random.randrange(80))
    if which in ("xml", "profiles"):
        texts = [grammar.variant(random).text or "" for _ in range(3)]
        text = f"<profiles>{''.join(texts)}</profiles>" if which == "profiles" else texts[0]
        octets = (
            text.encode().replace(b"<topic>", b'<topic profile_name="t">') if random.random() < 0.5 else text.encode()
        )
        return mutate_octets(random, octets, _XML_PIECES) if random.random() < 0.6 else octets
    if which == "identity":
        return random.randbytes(random.randrange(40))
    if random.random() < 0.5:
        packet = random.choice(packets(of_clients=random.random() < 0.5))
    else:
        session_id = random.choice((0x81, 0x80, 0x01, 0x00))
        make = random.choice((grammar.from_client, grammar.from_agent))
        said = [make(random) for _ in range(random.choice((1, 1, 2, 5)))]
        packet = grammar.message(random, Header(session_id, 0x80, 3, 9), said, wrong=0.2)
    return mutate_octets(random, packet, packets(of_clients=True)) if random.random() < 0.6 else packet


_XML_PIECES = (
    b"<dds>",
    b"</dds>",
    b"<!--",
    b"-->",
    b"<![CDATA[",
    b"]]>",
    b"<?",
    b"&lt;",
    b"&#x41;",
    b"<!DOCTYPE a>",
    b' a="1"b="2"',
)


def _message(data: bytes) -> Iterable[str]:
    header = decode_header(data)
    if decode_header(header.encode()) != header:
        raise Violation(f"header {header} is another one when written and read")
    for submessage in iter_submessages(data, header.size):
        _check_round_trip(submessage)
        yield type(submessage).__name__


def _check_round_trip(submessage: Submessage) -> None:
    if isinstance(submessage, Create) and not submessage.little_endian:
        return  # what is written is little endian, and the blob inside is left as it is
    octets = submessage.encode()
    again = list(iter_submessages(octets, 0))
    if again != [submessage] and not _is_long_login(submessage, again):
        raise Violation(f"{submessage!r} is {again!r} when written and read")


def _is_long_login(submessage: Submessage, again: list[Submessage]) -> bool:
    return isinstance(submessage, CreateClient) and submessage in again


def _explain(data: bytes) -> Iterable[str]:
    lines = explain(data)
    if not lines or not all(isinstance(line, str) for line in lines):
        raise Violation(f"explained as {lines!r}")
    return ("explained",)


def _variant(data: bytes) -> Iterable[str]:
    header = decode_header(data)
    for submessage in iter_submessages(data, header.size):
        if isinstance(submessage, Create):
            definition = parse_variant(submessage.variant, little_endian=submessage.little_endian)
            again = parse_variant(submessage.variant, little_endian=submessage.little_endian)
            if definition != again:
                raise Violation(f"{submessage.variant} is not equal to itself")
            yield type(definition).__name__


def _cdr(data: bytes) -> Iterable[str]:
    reader = CdrReader(data, len(data) and data[0] % 3, little_endian=bool(len(data) & 1))
    verbs: tuple[Callable[[], object], ...] = (
        reader.u8,
        reader.i8,
        reader.u16,
        reader.i16,
        reader.u32,
        reader.i32,
        reader.u64,
        reader.i64,
        reader.f32,
        reader.f64,
        reader.boolean,
        reader.string,
        reader.octet_sequence,
        lambda: reader.octets(3),
        lambda: reader.align(8),
    )
    for octet in data[-20:]:
        verbs[octet % len(verbs)]()
        if reader.offset > len(data) + 7:
            raise Violation(f"read to {reader.offset} of {len(data)} octets")
        yield str(octet % len(verbs))


def _xml(data: bytes) -> Iterable[str]:
    root = parse_xml(data.decode(errors="surrogateescape"))
    depth = _depth(root)
    if depth > MAX_DEPTH:
        raise Violation(f"XML of {depth} levels was read")
    return (f"{depth} deep", f"{len(list(root.leaves())).bit_length()} leaves")


def _depth(element: Element) -> int:
    return 1 + max((_depth(child) for child in element.children), default=0)


def _profiles(data: bytes) -> Iterable[str]:
    return (f"{len(References.parse(data.decode(errors='replace'), 'fuzz'))} profiles",)


def _identity(data: bytes) -> Iterable[str]:
    identity = decode_identity(data)
    if identity is not None and encode_identity(*identity) != data[:24]:
        raise Violation(f"identity {data[:24].hex()} is {encode_identity(*identity).hex()} when read and written")
    return (str(identity is None),)


def _discovery(data: bytes) -> Iterable[str]:
    answer = discovery_answer(data, lambda: ["127.0.0.1", "10.0.0.1"], 8888)
    return ("silence" if answer is None else f"{len(list(iter_submessages(answer, 4)))} answer",)


_DECODERS: dict[str, Callable[[bytes], Iterable[str]]] = {
    "message": _message,
    "explain": _explain,
    "variant": _variant,
    "cdr": _cdr,
    "xml": _xml,
    "profiles": _profiles,
    "identity": _identity,
    "discovery": _discovery,
}
