"""What a part tells about itself: `why` and names."""

from __future__ import annotations

import pytest

from msbot.pnp import PartState
from msbot.pnp.inventory_record import lasting
from tests.pnp.robot import Rig

AA = 0xAAAAAAAA


def test_why_tells_the_chain_of_rules_with_evidence() -> None:
    rig = Rig()
    rig.claim(AA, "ABCD", name="light", serial=0xA1)
    rig.now += 0.5
    lines = rig.inventory.why("light", rig.now)
    assert lines[0] == (
        "light (ABCD) is active since 0.5 s in slot AA, life 3, last beat less than 1 s ago: "
        "slot AA is the one free slot that fits"
    )
    assert "0.5 s ago: light: checking -> active in slot AA: slot AA is the one free slot that fits" in lines
    assert "  - library: ABCD is a light sensor" in lines
    assert "  - same UID as before: never seen here" in lines


@pytest.mark.parametrize(
    ("seconds", "words"),
    [
        (-1.0, "0.0 s"), (0.04, "0.0 s"), (9.9, "9.9 s"), (9.96, "10 s"), (119.0, "119 s"), (120.0, "2 min"),
        (7100.0, "118 min"), (7200.0, "2 h"), (172_000.0, "48 h"), (172_800.0, "2 days"), (1e7, "116 days"),
    ],
)  # fmt: skip
def test_a_time_is_as_exact_as_matters_after_so_long(seconds: float, words: str) -> None:
    assert lasting(seconds) == words


def test_of_a_healthy_part_the_life_status_stands_still_and_of_a_late_one_it_is_counted() -> None:
    rig = Rig()
    rig.claim(AA, "ABCD", name="light", serial=0xA1)
    for _ in range(10):  # beats of 1 s, ticks of 2 s: every second tick comes just before a beat
        rig.run(1.0)
        assert (rig.state(AA), rig.part(AA).life) == (PartState.ACTIVE, 3)
        assert "life 3" in rig.inventory.why("light", rig.now)[0]
        rig.beat(AA)
    rig.run(3.0)
    assert (rig.state(AA), rig.part(AA).life) == (PartState.LATE, 2)
    assert "life 2" in rig.inventory.why("light", rig.now)[0]


@pytest.mark.parametrize("word", ["LIGHT", "AA", "abcd", "00000000000000a1", "aaaaaaaa", "peer 2863311530"])
def test_why_knows_a_part_by_any_of_its_names(word: str) -> None:
    rig = Rig()
    rig.claim(AA, "ABCD", name="light", serial=0xA1)
    assert rig.inventory.why(word, rig.now)[0].startswith("light (ABCD)")


def test_why_of_somebody_unknown_lists_who_is_there() -> None:
    rig = Rig()
    assert rig.inventory.why("x", rig.now) == ["No part is known as 'x'. Parts seen: none yet."]
    rig.join(AA, "node 7")
    assert rig.inventory.why("x", rig.now) == ["No part is known as 'x'. Parts seen: node 7."]
    assert rig.inventory.why("node 7", rig.now)[0] == "node 7 is new since 0.0 s: a session was opened from node 7"


def test_a_name_cannot_steer_the_terminal_of_the_reader() -> None:
    rig = Rig()
    rig.claim(AA, "ABCD", name="\x1b[2Jevil" + "x" * 1000)
    part = rig.part(AA)
    assert part.local_name.startswith("?[2Jevil")
    assert len(part.local_name) == 255
    assert part.state is PartState.REFUSED
