"""A held port is bound to a topic of its own, and to its wire again afterwards; each change has another version."""

from __future__ import annotations

from dataclasses import replace

from hypothesis import given
from hypothesis import strategies as st

from msbot.pnp import Configuration, SlotBinding
from msbot.pnp.state_changes import HandControl

WIRED = Configuration(
    version=3,
    slot="fan",
    bindings=(
        SlotBinding("power", "fan_power", "Level", publishes=False),
        SlotBinding("speed", "fan_speed", "Number", publishes=True),
    ),
)


def test_nothing_changes_while_nobody_holds_anything() -> None:
    assert HandControl().apply_to(WIRED) is WIRED


def test_a_held_port_hears_the_master_and_nobody_else() -> None:
    hand = HandControl()
    held = hand.take("fan", "power", "Level")
    now = hand.apply_to(WIRED)
    assert {binding.port: binding.topic for binding in now.bindings} == {"speed": "fan_speed", "power": held.topic}
    assert now.version != WIRED.version


def test_a_port_without_a_wire_can_be_held() -> None:
    hand = HandControl()
    hand.take("fan", "swing", "Switch")
    assert [binding.port for binding in hand.apply_to(WIRED).bindings] == ["power", "speed", "swing"]


def test_a_port_that_is_let_go_is_bound_to_its_wire_again() -> None:
    hand = HandControl()
    hand.take("fan", "power", "Level")
    before = hand.apply_to(WIRED).version
    hand.let_go("fan", "power")
    after = hand.apply_to(WIRED)
    assert after.bindings == WIRED.bindings
    assert after.version not in (before, WIRED.version)


@given(st.lists(st.sampled_from(["take", "take other", "let go", "changed"]), max_size=40))
def test_every_change_gives_a_version_that_the_part_has_not_just_had(deeds: list[str]) -> None:
    hand, version, last = HandControl(), 1, None
    for deed in deeds:
        before = hand.apply_to(Configuration(version=version, slot="fan", bindings=WIRED.bindings))
        match deed:
            case "take":
                hand.take("fan", "power", "Level")
            case "take other":
                hand.take("fan", "swing", "Switch")
            case "let go":
                hand.let_go("fan", "power")
            case _:
                version += 1
        last = hand.apply_to(Configuration(version=version, slot="fan", bindings=WIRED.bindings))
        assert (last.version == before.version) == (last.bindings == before.bindings and deed != "changed")
        assert 1 <= last.version < 1 << 32


def test_the_whole_configuration_of_a_slot_while_ports_are_held_and_after() -> None:
    hand = HandControl()
    held = hand.take("fan", "power", "Level")
    by_hand = SlotBinding("power", "msbot_hand_fan_power", "Level", publishes=False)
    assert held.topic == by_hand.topic
    assert hand.apply_to(WIRED) == replace(WIRED, version=0x1_0003, bindings=(WIRED.bindings[1], by_hand))
    assert hand.take("fan", "power", "Level") == held
    assert hand.apply_to(WIRED).version == 0x1_0003, "it was held before"
    hand.let_go("fan", "power")
    hand.let_go("fan", "power")
    assert hand.apply_to(WIRED) == replace(WIRED, version=0x2_0003)
    assert hand.apply_to(replace(WIRED, version=0x5_FFFF)).version == 0x2_FFFF, (
        "of a version only the lower half is left"
    )
    other = replace(WIRED, slot="other")
    assert hand.apply_to(other) is other


def test_after_65535_changes_of_a_slot_the_count_begins_anew_and_never_at_0() -> None:
    hand = HandControl()
    for _ in range(0xFFFE // 2):
        hand.take("fan", "power", "Level")
        hand.let_go("fan", "power")
    assert hand.apply_to(WIRED).version == 0xFFFE_0003
    versions = []
    for _ in range(2):
        hand.take("fan", "power", "Level")
        versions.append(hand.apply_to(WIRED).version)
        hand.let_go("fan", "power")
        versions.append(hand.apply_to(WIRED).version)
    assert versions == [0xFFFF_0003, 0x1_0003, 0x2_0003, 0x3_0003]
