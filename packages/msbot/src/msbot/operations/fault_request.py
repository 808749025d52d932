"""What a person wants to go wrong. Pure."""

from __future__ import annotations

from msbot_xrce.lazy import dataclass


@dataclass(frozen=True, slots=True)
class FaultRequest:
    """What a person wants to go wrong; what is None is left to the kind."""

    kind: str
    at: str = ""
    amount: float | None = None
    jitter_ms: float | None = None
    port: str = ""
    number: str = ""
    after_s: float = 0.0
    for_s: float | None = None
    when: str = ""
    chance: float | None = None
    seed: int | None = None
    hidden: bool = False
