"""The fields of what relays and masters say to each other, for the dissector; `relay_messages` reads them."""

from __future__ import annotations

from typing import Final

from msbot_agent.link.relay import BOOT_SIZE, MARK, RelayKind
from msbot_xrce import Envelope, Form, LaidField

_PART: Final = LaidField("relay_part", 2, Form.BIG)
_COUNT: Final = LaidField("relay_count", 2, Form.BIG)
_BOOT: Final = LaidField("relay_boot", BOOT_SIZE, Form.OCTETS)
_WORDS: Final = LaidField("relay_words", 0, Form.TEXT)
_STOPS_SAID: Final = LaidField("relay_stops_said", 2, Form.BIG)
_STOPS: Final = LaidField("relay_stops", 2, Form.BIG)
_REST: Final = LaidField("relay_rest", 0, Form.OCTETS)

RELAY: Final = Envelope(
    "relay",
    MARK,
    {
        kind: (kind.name, fields)
        for kind, fields in {
            RelayKind.HELLO: (
                LaidField("relay_version", 1, Form.BIG),
                _BOOT,
                LaidField("relay_mtu", 4, Form.BIG),
                LaidField("relay_bits_per_second", 4, Form.BIG),
                LaidField("relay_flags", 1, Form.BIG, is_hexadecimal=True),
                LaidField("relay_name", 0, Form.TEXT),
                LaidField("relay_carried", 0, Form.TEXT),
            ),
            RelayKind.UP: (_PART, _WORDS),
            RelayKind.DOWN: (_PART, _COUNT),
            RelayKind.BEAT: (_COUNT, _STOPS_SAID, _REST),
            RelayKind.ROOM: (_REST,),
            RelayKind.BYE: (),
            RelayKind.WELCOME: (
                _BOOT,
                LaidField("relay_profile_hash", 4, Form.BIG, is_hexadecimal=True),
                _STOPS,
            ),
            RelayKind.HEARD: (_COUNT, _STOPS_SAID, _STOPS, LaidField("relay_reason", 1, Form.BIG)),
            RelayKind.WHO: (),
            RelayKind.REFUSED: (_WORDS,),
        }.items()
    },
    frozenset({int(RelayKind.UP), int(RelayKind.DOWN)}),
)
"""What begins with 00 FF 52."""
