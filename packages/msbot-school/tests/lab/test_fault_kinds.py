"""Each kind of fault: its symptom in what the page shows, and what `msbot why` says."""

from __future__ import annotations

from dataclasses import dataclass

import pytest

from msbot.registry import EditKind
from msbot_school.faults.fault_kinds import KINDS
from msbot_web.models.bus_models import BusFigures
from msbot_web.models.robot_models import PartLine, SlotCard
from tests.lab.fault_stage import FaultStage, fault_scene

PLANTED: dict[str, tuple[str, float | None, float]] = {
    "unplug": ("fan", None, 7), "late": ("knob", None, 8), "loss": ("fan", 40, 6), "delay": ("fan", 50, 10),
    "duplicates": ("knob", None, 3), "reordering": ("knob", None, 3), "slow-consumer": ("fan", None, 8),
    "duplicate-identity": ("fan", None, 2), "wrong-number": ("fan", None, 7), "stuck": ("knob", None, 2),
    "drift": ("knob", 600, 4), "bus-off": ("fan", None, 8), "bit-errors": ("", 2000, 3), "babbling": ("", 90, 1.5),
    "master-frozen": ("", None, 7), "database-gone": ("", None, 0.1),
}  # fmt: skip
"""What is planted where, how strong, and how many seconds it is watched."""
MORE: dict[str, dict[str, object]] = {"delay": {"jitter": 900}}


@dataclass
class Seen:
    """What the page shows of one fault."""

    before: SlotCard
    during: SlotCard
    states: set[str]
    arrivals: list[PartLine]
    bus_before: BusFigures
    bus: BusFigures
    why: str
    why_other: str
    trouble: str
    turned: float
    """How far the knob is really turned."""
    values: list[float]
    """What the knob said."""
    intervals: list[float]
    """Seconds between beats."""


async def watch(stage: FaultStage, kind: str) -> Seen:
    at, amount, seconds = PLANTED[kind]
    slot = at or "fan"
    await stage.turn(0.5)
    before, bus_before = stage.card(slot), stage.page.bus()
    await stage.plant(kind, at, amount=amount, **MORE.get(kind, {}))
    states, values = set(), []
    for _ in range(round(seconds / 0.1)):
        await stage.turn(0.1)
        stage.page.poll()
        states.add(stage.card(slot).state)
        value = stage.value("knob", "level")
        values.append(value)
    if kind == "database-gone":
        stage.operations.faults.running.note(EditKind.HAND, "something", "Ada")
        stage.registry.storage.flush(60.0)  # ends with the first try that fails
    seen = Seen(
        before,
        stage.card(slot),
        states,
        stage.page.arrivals(),
        bus_before,
        stage.page.bus(),
        stage.why(slot),
        stage.why("knob" if slot == "fan" else "fan"),
        stage.registry.storage.health.trouble or "",
        20.0 + stage.turned,
        values,
        stage.page.beat_intervals(slot),
    )
    await stage.quiet()
    return seen


@pytest.fixture(scope="module")
def seen(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Seen]:
    """One robot that goes through everything."""
    found: dict[str, Seen] = {}

    async def scene(stage: FaultStage) -> None:
        for kind in PLANTED:
            found[kind] = await watch(stage, kind)

    fault_scene(tmp_path_factory.mktemp("kinds"), scene)
    return found


def test_all_kinds_are_here() -> None:
    assert {*PLANTED, "wrong-key"} == set(KINDS)


@pytest.mark.parametrize("kind", PLANTED)
def test_why_and_card_say_that_it_is_planted(kind: str, seen: dict[str, Seen]) -> None:
    at, _, _ = PLANTED[kind]
    sentence = f"Ada has planted fault {list(PLANTED).index(kind) + 1} here: {kind}"
    assert sentence in seen[kind].why
    assert bool(at) == any(sentence in told for told in seen[kind].during.faults)
    assert (sentence in seen[kind].why_other) == (not at)
    assert sentence not in "".join(seen[kind].before.faults)


def test_unplug(seen: dict[str, Seen]) -> None:
    card = seen["unplug"].during
    assert (card.state, card.plugged) == ("lost", False)
    assert "no beat for" in seen["unplug"].why


def test_late(seen: dict[str, Seen]) -> None:
    assert seen["late"].states == {"active", "late"}
    assert "heard again after" in seen["late"].why


def _worn(seen: Seen) -> tuple[int, int, int]:
    before, after = seen.before.wear, seen.during.wear
    assert before is not None
    assert after is not None
    return after.repeated - before.repeated, after.resent - before.resent, after.unread - before.unread


def test_loss(seen: dict[str, Seen]) -> None:
    assert _worn(seen["loss"])[1] > 5
    assert "messages were sent to it again" in seen["loss"].why


def test_delay(seen: dict[str, Seen]) -> None:
    lately = seen["delay"].intervals[-8:]
    assert max(lately) - min(lately) > 0.2
    quiet = seen["duplicates"].intervals[-2:]
    assert quiet == pytest.approx([1.0, 1.0], abs=0.15)


def test_duplicates(seen: dict[str, Seen]) -> None:
    assert _worn(seen["duplicates"])[0] > 5
    assert "of its messages came twice or too late" in seen["duplicates"].why


def test_reordering(seen: dict[str, Seen]) -> None:
    assert _worn(seen["reordering"])[0] > 3


def test_slow_consumer(seen: dict[str, Seen]) -> None:
    assert _worn(seen["slow-consumer"])[2] > 5
    assert "it takes them too slowly" in seen["slow-consumer"].why


def test_duplicate_identity(seen: dict[str, Seen]) -> None:
    part = seen["duplicate-identity"].during.part
    assert part is not None
    assert part.state == "active"
    assert part.duplicates == ["in-process client 1"]
    assert "The same UID was shown, and refused" in seen["duplicate-identity"].why


def test_wrong_number(seen: dict[str, Seen]) -> None:
    assert seen["wrong-number"].during.state == "lost"
    (arrived,) = [part for part in seen["wrong-number"].arrivals if part.part == "fan?"]
    assert "this robot has no slot for it" in arrived.reason


def test_stuck(seen: dict[str, Seen]) -> None:
    said = set(seen["stuck"].values[5:])
    assert len(said) == 1
    assert abs(said.pop() - seen["stuck"].turned) > 5
    assert len(set(seen["duplicates"].values)) > 10


def test_drift(seen: dict[str, Seen]) -> None:
    assert 30 < seen["drift"].values[-1] - seen["drift"].turned < 45  # 600 a minute, for 4 s


def test_bus_off(seen: dict[str, Seen]) -> None:
    assert seen["bus-off"].during.state == "lost"
    assert seen["bus-off"].bus.errors - seen["bus-off"].bus_before.errors >= 32


def test_bit_errors(seen: dict[str, Seen]) -> None:
    assert seen["bit-errors"].bus.errors > seen["bit-errors"].bus_before.errors + 5


def test_babbling(seen: dict[str, Seen]) -> None:
    assert seen["babbling"].bus_before.load_percent < 20
    assert seen["babbling"].bus.load_percent > 85


def test_master_frozen(seen: dict[str, Seen]) -> None:
    assert seen["master-frozen"].during.state == "lost"


def test_database_gone(seen: dict[str, Seen]) -> None:
    assert "cannot be reached; changes kept in memory until it can be written" in seen["database-gone"].trouble
