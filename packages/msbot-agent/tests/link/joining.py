"""What the tests of both sides of joining share: frames with literal numbers."""

from __future__ import annotations

from hypothesis import strategies as st

from msbot_agent.link.can.protocol.frames import Frame
from msbot_agent.link.can.protocol.ids import Assign, Beacon, CanIds, assign_frame, beacon_frame, join_frame

IDS = CanIds()
HASH = 0xCAFE
UID = bytes(range(1, 9))


def uid(number: int) -> bytes:
    return b"part" + number.to_bytes(4, "big")


def assign(node_id: int, *, epoch: int = 5, to: bytes = UID, use: int = 0) -> Frame:
    return assign_frame(Assign(to, node_id, epoch, use), IDS)


def beacon(epoch: int = 5, profile_hash: int = HASH) -> Frame:
    return beacon_frame(Beacon(0, epoch, profile_hash), IDS)


any_frame = st.one_of(
    st.builds(Frame, st.integers(0, (1 << 29) - 1), st.binary(max_size=8), st.booleans(), st.booleans()),
    st.builds(lambda n, caps: join_frame(uid(n), caps, IDS), st.integers(1, 200), st.integers(0, 3)),
    st.builds(
        lambda n, e, to: assign(n, epoch=e, to=to),
        st.integers(0, 120),
        st.integers(0, 9),
        st.sampled_from([UID, uid(1)]),
    ),
    st.builds(beacon, st.integers(0, 9), st.sampled_from([HASH, 1])),
)
