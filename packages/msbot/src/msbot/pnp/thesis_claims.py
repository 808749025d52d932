"""The claims of the thesis' own parts, which know neither leases nor UIDs (thesis 3.12.2).

Every request of such a part either registers it or is its heartbeat; `msbot.part.join.thesis_messages` has the layout.

DEVIATION: the thesis' replier answers everybody; here a stranger gets no answer (R52), and only a registered part gets
    its number back.
"""

from __future__ import annotations

from msbot.part.join.thesis_messages import BUFFER_BYTES, read_string
from msbot.pnp.model import Claim
from msbot_xrce.errors import RemoteProtocolError


def decode_thesis_claim(body: bytes) -> Claim:
    """Read a request of the thesis as a claim.

    Raises:
        RemoteProtocolError: not 96 octets, or not two strings in them.
    """
    if len(body) != BUFFER_BYTES:
        raise RemoteProtocolError(f"request of {len(body)} bytes, expected {BUFFER_BYTES}")
    part_number, offset = read_string(body, 0)
    local_name, _ = read_string(body, offset)
    return Claim(part_number=part_number, local_name=local_name, layout="compat")
