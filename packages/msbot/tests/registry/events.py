"""Events as the inventory makes them."""

from msbot.pnp import Claim, PartEvent, PartState

UID = bytes.fromhex("0011223344556677")
CLAIM = Claim("ABCD", "ABCD-local", UID)


def changed(
    to: PartState,
    *,
    before: PartState | None = PartState.CHECKING,
    slot: str | None = "AA",
    reason: str = "because",
    number: str = "ABCD",
    local_name: str = "ABCD-local",
    uid: bytes = UID,
    key: int = 1,
) -> PartEvent:
    """One change of a part's state."""
    return PartEvent(
        at=12.5,
        part=local_name or number or "udp 127.0.0.1:5",
        slot=slot,
        from_state=before,
        to_state=to,
        reason=reason,
        evidence=(("part number", "is in the library"), ("slot", "AA is free")),
        part_number=number,
        local_name=local_name,
        uid=uid,
        client_key=key,
        address="udp 127.0.0.1:5",
    )
