"""The database gives a robot's blueprint back: as it was applied, and as it holds."""

from dataclasses import replace
from pathlib import Path

from msbot.config import Binding, Blueprint, InDds, Library, Options, SlotPort, Timing, open_blueprint
from msbot.registry import Registry
from tests.registry.blueprint.test_blueprint_store import LIBRARY, ROBOT
from tests.registry.hand import Hand


def test_the_sample_comes_back(registry: Registry, blueprint: Blueprint, library: Library) -> None:
    robot = registry.robots.apply_blueprint(blueprint, library)
    assert (
        registry.robots.blueprint(robot)
        == registry.robots.blueprint(robot, by_hand=False)
        == replace(blueprint, source=None)
    )
    assert registry.robots.find(blueprint) == robot
    assert registry.robots.find(ROBOT) is None


def test_all_of_a_blueprint_comes_back(registry: Registry) -> None:
    options = Options(explain=True, free_topics=("chat",), authentication="key")
    shown = InDds(
        export=True, ros=True, ros_type="geometry_msgs/msg/Vector3", ros_fields=(("b", "y"), ("a", "x")), ros_topic="/x"
    )
    bindings = tuple(replace(binding, in_dds=shown) for binding in ROBOT.bindings)
    timing = Timing("fast", 0.25, 0.5, 7, 1.0)
    whole = replace(ROBOT, timing=timing, options=options, bindings=bindings)
    assert registry.robots.blueprint(registry.robots.apply_blueprint(whole, LIBRARY)) == whole


def test_what_was_made_by_hand_is_told_apart(registry: Registry) -> None:
    robot = registry.robots.apply_blueprint(ROBOT, LIBRARY)
    Hand(registry).set_value(robot, "left", "period_s", 9, "Ann")
    Hand(registry).set_value(robot, "right", "invert", True, "Bob")
    Hand(registry).unbind(robot, "brightness", SlotPort("leg", "goal"), "Ann")
    Hand(registry).bind(robot, "glow", "Ann", type_name="Light", source=None, targets=[SlotPort("right", "lamp")])
    assert registry.robots.blueprint(robot, by_hand=False) == ROBOT
    held = registry.robots.blueprint(robot)
    assert [slot.settings for slot in held.slots] == [{"period_s": 9}, {"invert": True}, {}]
    assert held.bindings == (
        Binding("brightness", "Light", SlotPort("left", "light"), ()),
        Binding("glow", "Light", SlotPort("", ""), (SlotPort("right", "lamp"),)),
    )
    assert registry.robots.made_by_hand(robot) == {
        ("left", "period_s"): "set by hand by Ann",
        ("right", "invert"): "set by hand by Bob",
        ("brightness", ""): "changed by hand",
        ("glow", ""): "changed by hand",
    }


def test_the_library_of_ones_own_comes_back(registry: Registry, tmp_path: Path) -> None:
    (tmp_path / "parts").mkdir()
    own = 'number = "{0}"\nname = "x"\n[[port]]\nname = "light"\ndirection = "publish"\ntype = "Light"\n'
    (tmp_path / "parts/lux.toml").write_text(own.format("LUX-1"))
    (tmp_path / "parts/other.toml").write_text(own.format("LUX-2"))
    path = tmp_path / "robot.toml"
    folder = str(tmp_path / "parts")
    path.write_text(f'library = ["{folder}"]\n[robot]\nname = "R"\n[[slot]]\nname = "eye"\npart = "LUX-1"\n')
    blueprint, library = open_blueprint(path)
    robot = registry.robots.apply_blueprint(blueprint, library)
    assert registry.robots.blueprint(robot) == replace(blueprint, source=None)


def test_a_library_that_no_slot_needs_and_one_of_another_folder_come_back_as_written(
    registry: Registry, tmp_path: Path
) -> None:
    own = 'number = "{0}"\nname = "x"\n[[port]]\nname = "light"\ndirection = "publish"\ntype = "Light"\n'
    for folder, number in (("kit", "LUX-1"), ("spare", "LUX-2"), ("given", "LUX-3")):
        (tmp_path / folder).mkdir()
        (tmp_path / folder / "lux.toml").write_text(own.format(number))
    path = tmp_path / "robot.toml"
    slots = "".join(f'[[slot]]\nname = "{number}"\npart = "{number}"\n' for number in ("LUX-1", "LUX-3"))
    path.write_text(f'library = ["kit", "spare"]\n[robot]\nname = "R"\n{slots}')
    blueprint, library = open_blueprint(path, tmp_path / "given")
    robot = registry.robots.apply_blueprint(blueprint, library)
    assert registry.robots.blueprint(robot).library == ("kit", "spare", str(tmp_path / "given"))
