"""The database gives a robot's blueprint back: as it was applied, and as it holds."""

from dataclasses import replace

from msbot.config import Binding, Blueprint, Endpoint, Library, Options, Timing
from msbot.registry import Registry
from tests.registry.test_blueprint_store import LIBRARY, ROBOT


def test_the_sample_comes_back(registry: Registry, blueprint: Blueprint, library: Library) -> None:
    robot = registry.apply_blueprint(blueprint, library)
    assert registry.blueprint(robot) == registry.blueprint(robot, by_hand=False) == replace(blueprint, source=None)
    assert registry.find_robot(blueprint) == robot
    assert registry.find_robot(ROBOT) is None


def test_all_of_a_blueprint_comes_back(registry: Registry) -> None:
    options = Options(explain=True, free_topics=("chat",), authentication="key")
    whole = replace(ROBOT, timing=Timing("fast", 0.25, 0.5, 7, 1.0), options=options)
    assert registry.blueprint(registry.apply_blueprint(whole, LIBRARY)) == whole


def test_what_was_made_by_hand_is_told_apart(registry: Registry) -> None:
    robot = registry.apply_blueprint(ROBOT, LIBRARY)
    registry.set_value(robot, "left", "period_s", 9, "Ann")
    registry.set_value(robot, "right", "invert", True, "Bob")
    registry.unbind(robot, "brightness", Endpoint("leg", "goal"), "Ann")
    registry.bind(robot, "glow", "Ann", type_name="Light", source=None, targets=[Endpoint("right", "lamp")])
    assert registry.blueprint(robot, by_hand=False) == ROBOT
    held = registry.blueprint(robot)
    assert [slot.settings for slot in held.slots] == [{"period_s": 9}, {"invert": True}, {}]
    assert held.bindings == (
        Binding("brightness", "Light", Endpoint("left", "light"), ()),
        Binding("glow", "Light", Endpoint("", ""), (Endpoint("right", "lamp"),)),
    )
    assert registry.made_by_hand(robot) == {
        ("left", "period_s"): "set by hand by Ann",
        ("right", "invert"): "set by hand by Bob",
        ("brightness", ""): "changed by hand",
        ("glow", ""): "changed by hand",
    }
