"""Header compression: any octets come back as they were, any octets may be a compressed message."""

from __future__ import annotations

from collections.abc import Iterable
from random import Random

from fuzz import grammar
from fuzz.case import Case, Step, Violation, plain
from fuzz.corpus import packets
from fuzz.mutate import LONGEST, mutate_octets
from msbot_xrce.compression import LARGEST, compress, decompress
from msbot_xrce.errors import RemoteProtocolError
from msbot_xrce.messages import Header

LARGEST_PLAIN = max(LARGEST, LONGEST) + 16


class CompactTarget:
    """See the module's docstring."""

    name = "compact"
    about = "header compression: decompress(compress(x)) == x, RemoteProtocolError only, no bombs"

    def make(self, random: Random) -> Case:
        """One packet, or the short form of one."""
        if random.random() < 0.5:
            packet = random.choice(packets(of_clients=random.random() < 0.5))
        else:
            session_id = random.choice((0x81, 0x82, 0x80, 0x01))
            header = Header(session_id, random.choice(grammar.STREAMS), random.choice((0, 1, 200, 0xFFFF)), 9)
            make = random.choice((grammar.from_client, grammar.from_agent))
            packet = grammar.message(random, header, [make(random)], wrong=0.1)
        if random.random() < 0.5:
            packet = mutate_octets(random, packet, packets(of_clients=True))
        if random.random() < 0.5:
            return (Step("plain", packet),)
        short = compress(packet)
        return (Step("short", mutate_octets(random, short) if random.random() < 0.8 else short),)

    def run(self, case: Case) -> Iterable[str]:
        """Compress, or expand."""
        seen = set()
        for step in case:
            if step.verb == "plain":
                short = compress(step.data)
                if len(short) > len(step.data) + 1:
                    raise Violation(f"{len(step.data)} octets have become {len(short)}")
                if decompress(short) != step.data:
                    raise Violation(f"{step.data.hex()} came back as {decompress(short).hex()}")
                seen.add(f"form {short[0] if short else -1:02x} {min(len(short), 9)}")
            elif step.verb == "short":
                seen |= _expand(step.data)
        return seen


def _expand(data: bytes) -> set[str]:
    try:
        whole = decompress(data)
    except RemoteProtocolError as error:
        return {f"refused: {plain(str(error), 30)}"}
    if len(whole) > LARGEST_PLAIN:
        raise Violation(f"{len(data)} octets have become {len(whole)}")
    if decompress(compress(whole)) != whole:
        raise Violation(f"{data.hex()} is a form of {whole.hex()}, which does not come back")
    return {f"expanded {data[0] & 0x1F} {len(whole).bit_length()}"}
