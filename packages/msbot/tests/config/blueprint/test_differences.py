"""What differs between two blueprints, in words."""

from dataclasses import replace

from msbot.config import (
    PRESETS,
    Binding,
    Blueprint,
    Difference,
    InDds,
    Options,
    RobotProfile,
    Slot,
    SlotPort,
    differences,
)

ROBOT = Blueprint(
    RobotProfile("R2", "V1", "007", "today", "us"),
    (Slot("left", "EYE", settings={"period_s": 1}), Slot("leg", "LEG", "LEG-1", "walks")),
    (Binding("light", "Light", SlotPort("left", "light"), (SlotPort("leg", "goal"),)),),
)


def _lines(new: Blueprint) -> list[str]:
    return [str(difference) for difference in differences(ROBOT, new)]


def test_the_same_has_no_difference() -> None:
    turned = replace(ROBOT, slots=tuple(reversed(ROBOT.slots)))
    assert differences(ROBOT, ROBOT) == differences(ROBOT, turned) == ()


def test_profile_timing_and_options() -> None:
    new = replace(
        ROBOT,
        robot=replace(ROBOT.robot, version="V2"),
        timing=replace(PRESETS["thesis"], preset="fast", life=4),
        options=Options(explain=False, free_topics=("chat",)),
    )
    later = " (holds from the master's next start on)"
    assert _lines(new) == [
        f'~ robot, version: "V1" -> "V2"{later}',
        f"~ timing, life: 3 -> 4{later}",
        f"~ options, explain: true -> false{later}",
        f'~ options, free_topics: [] -> ["chat"]{later}',
    ]


def test_slots() -> None:
    changed = Slot("left", "NOSE", "N", settings={"period_s": True, "gain": 0.5})
    new = replace(ROBOT, slots=(changed, Slot("arm", "LEG", settings={"speed": "slow"})))
    assert _lines(new) == [
        "- slot leg: part LEG (a part in it is delisted; settings and memory are kept in case it comes back)",
        "~ slot left, part: EYE -> NOSE (a part in it that does not fit any more is delisted)",
        '~ slot left, local_name: "" -> "N"',
        "~ slot left, period_s: 1 -> true",
        "+ slot left, gain: 0.5",
        '+ slot arm: part LEG, speed = "slow"',
    ]
    without = replace(ROBOT, slots=(replace(ROBOT.slots[0], settings={}), replace(ROBOT.slots[1], description="")))
    assert _lines(without) == [
        "- slot left, period_s: 1 (the library's value holds again)",
        '~ slot leg, description: "walks" -> ""',
    ]


def test_topics() -> None:
    wire = ROBOT.bindings[0]
    more = replace(wire, targets=(SlotPort("left", "lamp"), *wire.targets), reliable=False)
    other = Binding("heat", "Heat", SlotPort("", ""), (SlotPort("leg", "skin"),))
    assert _lines(replace(ROBOT, bindings=(more, other))) == [
        "~ topic light: left.light -> leg.goal [Light] -> left.light -> left.lamp, leg.goal [Light, best effort]",
        "+ topic heat: nobody -> leg.skin [Heat]",
    ]

    assert _lines(replace(ROBOT, bindings=())) == ["- topic light: left.light -> leg.goal [Light]"]
    second = replace(wire, source=SlotPort("leg", "light"))
    (two,) = differences(ROBOT, replace(ROBOT, bindings=(second, wire)))
    assert two == Difference(
        "changed", "topic light", "left.light -> leg.goal [Light]", "leg.light, left.light -> leg.goal [Light]"
    )


def test_what_a_topic_is_in_dds() -> None:
    shown = InDds(export=True, ros=True, ros_type="std_msgs/Float32", ros_fields=(("lux", "data"),))
    assert _lines(replace(ROBOT, bindings=(replace(ROBOT.bindings[0], in_dds=shown),))) == [
        "~ topic light: left.light -> leg.goal [Light] -> left.light -> leg.goal "
        "[Light, exported, in ROS 2 as std_msgs/Float32 lux = data]",
    ]
