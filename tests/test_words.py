"""docs/reference/words.md and the code: one word for one thing."""

import ast
import re
from collections import defaultdict
from functools import cache
from pathlib import Path

from tools.sources import dotted, source_files

ROOT = Path(__file__).parent.parent
PAGE = (ROOT / "docs/reference/words.md").read_text()


@cache
def rooms_of_classes() -> dict[str, set[str]]:
    """Public class -> the rooms that define one of that name."""
    rooms = defaultdict(set)
    for path in source_files():
        package, *rest = dotted(path).split(".")
        room = {"msbot_xrce": "xrce", "msbot_web": "web"}.get(package) or (rest[0] if rest else package)
        for node in ast.parse(path.read_text()).body:
            if isinstance(node, ast.ClassDef) and not node.name.startswith("_"):
                rooms[node.name].add(room)
    return dict(rooms)


SHARED_ON_PURPOSE = {
    "Fit": {"bridge", "web"},  # what a world says of a message; the same, as the page asks for it without bridges
    "Header": {"ros2", "xrce"},  # ROS' message std_msgs/Header; the header of a DDS-XRCE message
    "Number": {"part"},  # the standard message; the type of a number in a message: students write both
    "Temperature": {"part", "ros2"},  # the standard message; ROS' sensor_msgs/Temperature
    "Parameter": {"config", "ros2"},  # what can be set about a part; ROS' rcl_interfaces/Parameter
    "Pose": {"part", "ros2"},  # the standard message; ROS' geometry_msgs/Pose
    "Strip": {"hardware", "part"},  # the driver of a strip of lamps; the standard message that it takes
    "Session": {"web", "xrce"},  # a term of the web; of DDS-XRCE
}
"""Names that mean two things, each the term of its field, with the rooms that have them."""


def test_no_class_name_means_two_things_in_two_rooms() -> None:
    double = {name: rooms for name, rooms in rooms_of_classes().items() if len(rooms) > 1}
    new = {name: rooms for name, rooms in double.items() if not rooms <= SHARED_ON_PURPOSE.get(name, set())}
    assert new == {}, "give these classes names of their own, or a line with the reason in SHARED_ON_PURPOSE"


def test_names_shared_on_purpose_are_there() -> None:
    rooms = rooms_of_classes()
    assert {name: said for name, said in SHARED_ON_PURPOSE.items() if said != rooms.get(name)} == {}


def test_every_word_is_explained_once() -> None:
    rows = re.findall(r"^\* ([^:]*): ", PAGE, re.MULTILINE)
    words = [word.strip() for row in rows for word in row.split(",")]
    assert len(words) > 40
    assert sorted({word for word in words if words.count(word) > 1}) == []
