"""Names of nodes: whatever people call their robots, slots and boards, ROS 2 accepts them and can tell them apart."""

from __future__ import annotations

import re

import pytest
from hypothesis import given
from hypothesis import strategies as st

from msbot_agent.ros.node_names import LONGEST, NodeName, node_named, robot_node, slot_nodes

WORD = re.compile(r"[A-Za-z_][A-Za-z0-9_]*")


@pytest.mark.parametrize(
    ("participant", "node"),
    [
        ("blinker", NodeName("/", "blinker")),
        ("/garden/blinker", NodeName("/garden", "blinker")),
        ("/garden/north/blinker", NodeName("/garden/north", "blinker")),
        ("my board", NodeName("/", "my_board")),
        ("/", NodeName("/", "_")),
    ],
)
def test_a_participant_of_micro_ros_names_its_node(participant: str, node: NodeName) -> None:
    assert node_named(participant) == node


def test_slots_live_in_the_namespace_of_their_robot() -> None:
    nodes = slot_nodes("ROVER-1", ["knob", "left wheel", "left-wheel", "2nd"])
    assert [str(node) for node in nodes.values()] == [
        "/ROVER_1/knob",
        "/ROVER_1/left_wheel",
        "/ROVER_1/left_wheel_2",
        "/ROVER_1/_2nd",
    ]
    assert str(robot_node("ROVER-1")) == "/ROVER_1"


@given(st.text(min_size=1, max_size=300), st.lists(st.text(min_size=1, max_size=300), unique=True, max_size=5))
def test_every_name_is_one_for_ros_and_no_two_are_the_same(robot: str, slots: list[str]) -> None:
    nodes = slot_nodes(robot, slots)
    assert len(set(nodes.values())) == len(slots)
    for node in (*nodes.values(), robot_node(robot), node_named(robot)):
        assert WORD.fullmatch(node.name)
        assert all(WORD.fullmatch(word) for word in node.namespace.split("/")[1:] if word)
        assert len(node.namespace) <= LONGEST + 1
