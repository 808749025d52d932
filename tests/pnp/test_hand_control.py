"""A held port is bound to a topic of its own, and to its wire again afterwards; each change has another version."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from msbot.pnp import Configuration, SlotBinding
from msbot.pnp.hand_control import HandControl

WIRED = Configuration(
    version=3, slot="fan", bindings=(SlotBinding("power", "fan_power", "Level", publishes=False),
                                     SlotBinding("speed", "fan_speed", "Number", publishes=True)),
)  # fmt: skip


def test_nothing_changes_while_nobody_holds_anything() -> None:
    assert HandControl().over(WIRED) is WIRED


def test_a_held_port_hears_the_master_and_nobody_else() -> None:
    hand = HandControl()
    held = hand.take("fan", "power", "Level")
    now = hand.over(WIRED)
    assert {binding.port: binding.topic for binding in now.bindings} == {"speed": "fan_speed", "power": held.topic}
    assert now.version != WIRED.version


def test_a_port_without_a_wire_can_be_held() -> None:
    hand = HandControl()
    hand.take("fan", "swing", "Switch")
    assert [binding.port for binding in hand.over(WIRED).bindings] == ["power", "speed", "swing"]


def test_a_port_that_is_let_go_is_bound_to_its_wire_again() -> None:
    hand = HandControl()
    hand.take("fan", "power", "Level")
    before = hand.over(WIRED).version
    hand.let_go("fan", "power")
    after = hand.over(WIRED)
    assert after.bindings == WIRED.bindings
    assert after.version not in (before, WIRED.version)


@given(st.lists(st.sampled_from(["take", "take other", "let go", "changed"]), max_size=40))
def test_every_change_gives_a_version_that_the_part_has_not_just_had(deeds: list[str]) -> None:
    hand, version, last = HandControl(), 1, None
    for deed in deeds:
        before = hand.over(Configuration(version=version, slot="fan", bindings=WIRED.bindings))
        match deed:
            case "take":
                hand.take("fan", "power", "Level")
            case "take other":
                hand.take("fan", "swing", "Switch")
            case "let go":
                hand.let_go("fan", "power")
            case _:
                version += 1
        last = hand.over(Configuration(version=version, slot="fan", bindings=WIRED.bindings))
        assert (last.version == before.version) == (last.bindings == before.bindings and deed != "changed")
        assert 1 <= last.version < 1 << 32
