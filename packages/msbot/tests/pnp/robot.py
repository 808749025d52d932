"""The sample robot of the thesis and one inventory, for all tests of this room."""

from __future__ import annotations

from random import Random

from msbot.config import PartType, Slot
from msbot.pnp import (
    THESIS_TIMING,
    Claim,
    Configuration,
    LifeTiming,
    MemoryStore,
    PartEvent,
    PartInfo,
    PartState,
    SlotBinding,
    Verdict,
)
from msbot.pnp.inventory import Inventory

ABCD = PartType("ABCD", "light sensor", description="light sensor", specification="5V")
EFGH = PartType("EFGH", "toggle switch", description="toggle switch", specification="5V")
WXYZ = PartType("WXYZ", "motor driver", description="motor driver", specification="5V")

RING = {"AA": ("ABCD", "1_to_2", "3_to_1"), "BB": ("EFGH", "2_to_3", "1_to_2"), "CC": ("WXYZ", "3_to_1", "2_to_3")}


def configuration(slot: str, version: int = 1) -> Configuration:
    """A ring slot's configuration: one topic out, one in."""
    _, out, into = RING[slot]
    return Configuration(
        version=version,
        slot=slot,
        bindings=(
            SlotBinding("out", f"HelloWorldTopic_{out}", "HelloWorld", publishes=True),
            SlotBinding("in", f"HelloWorldTopic_{into}", "HelloWorld", publishes=False, reliable=False),
        ),
        settings=(("period_s", "1.0"),),
    )


def sample_store(*more: Slot) -> MemoryStore:
    """The thesis' library and ring, and further slots."""
    return MemoryStore(
        types=(ABCD, EFGH, WXYZ),
        slots=(*(Slot(name, number) for name, (number, _, _) in RING.items()), *more),
        configurations=tuple(configuration(slot) for slot in RING),
    )


def uid(number: int) -> bytes:
    """An 8-byte UID."""
    return number.to_bytes(8, "big")


class Rig:
    """An inventory with a clock that the test turns by hand; sessions are opened by their first claim."""

    def __init__(
        self, store: MemoryStore | None = None, *, timing: LifeTiming = THESIS_TIMING, start: float = 100.0
    ) -> None:
        self.now = start
        self.store = store or sample_store()
        self.inventory = Inventory(self.store, random=Random(1), now=start, timing=timing, keep_ended=4)
        self.events: list[PartEvent] = []
        self.rights: list[int] = []
        self.leases: dict[int, int] = {}
        self._open: set[int] = set()
        self.inventory.on_event(self.events.append)
        self.inventory.on_rights(self.rights.append)

    def join(self, key: int, address: str = "", **more: float | str) -> None:
        self._open.add(key)
        self.inventory.client_joined(key, address or f"peer {key}", self.now, **more)  # type: ignore[arg-type]

    def leave(self, key: int, reason: str = "session deleted", *, politely: bool = True) -> None:
        self._open.discard(key)
        self.inventory.client_left(key, reason, self.now, politely=politely)

    def claim(
        self,
        key: int,
        number: str,
        *,
        name: str = "",
        serial: int | None = None,
        nonce: int = 0,
        layout: str = "compact",
    ) -> Verdict:
        """Claim through a session; `serial` gives the UID, by default one of the session."""
        if key not in self._open:
            self.join(key)
        octets = uid(key if serial is None else serial) if layout == "compact" else b""
        verdict = self.inventory.claim(Claim(number, name, octets, nonce, layout), key, self.now)
        if verdict.lease:
            self.leases[key] = verdict.lease
        return verdict

    def beat(self, key: int) -> int:
        return self.inventory.beat(self.leases.get(key, 0), key, self.now)

    def run(self, seconds: float, *beating: int) -> None:
        """Let time pass; those parts beat with the robot's period, from one period after now on."""
        end, beat_s = self.now + seconds, self.inventory.timing.beat_s
        beats = [self.now + beat_s * n for n in range(1, int(seconds / beat_s + 1e-9) + 1)]
        while True:
            due = min(self.inventory.timer(), beats[0] if beats else end, end)
            self.now = due
            if beats and beats[0] <= due:
                beats.pop(0)
                for key in beating:
                    self.beat(key)
            self.inventory.handle_timer(due)
            if due >= end:
                return

    def part(self, key: int) -> PartInfo:
        """The part that speaks through that session, or spoke last."""
        return [info for info in self.inventory.view(self.now) if info.client_key == key][-1]

    def state(self, key: int) -> PartState:
        return self.part(key).state

    def changes(self, key: int) -> list[str]:
        """The states a session's part went through."""
        return [event.to_state.value for event in self.events if event.client_key == key]
