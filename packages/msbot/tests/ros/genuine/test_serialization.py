"""Messages of ROS 2 as genuine ROS 2 reads and writes them: the same octets, padding aside, both ways."""

from __future__ import annotations

import os
import subprocess
from collections import Counter

from hypothesis import Phase, given, settings

from msbot.part import Message
from msbot.ros2.forms import MOST_BEHIND
from msbot.ros2.known_types import ROS_TYPES
from tests.idl.generated import messages
from tests.ros.genuine.environment import PROGRAMS, environment

EACH = 10
MEANS_NOTHING = "std_msgs/msg/Empty"
"""It has one octet on the wire, since a type of DDS needs one, and ROS 2 forgets its value."""


def some(cls: type[Message]) -> list[bytes]:
    """Different messages of a class, the same ones every time."""
    found: dict[bytes, None] = {}

    @settings(max_examples=EACH, derandomize=True, database=None, phases=[Phase.generate], deadline=None)
    @given(messages(cls))
    def collect(message: Message) -> None:
        found[message.encode()] = None

    collect()
    return list(found)


def test_seventy_types_are_read_and_written_as_ros_does() -> None:
    asked = [
        (cls, f"{package}/msg/{name.removesuffix('_')}", octets)
        for cls in ROS_TYPES.values()
        for package, kind, _, name in [cls.type_name.split("::")]
        if kind == "msg"
        for octets in some(cls)
    ]
    place = environment()
    done = subprocess.run(
        [str(place / "bin/python"), str(PROGRAMS / "serialization.py")],
        input="\n".join(f"{name} {octets.hex()}" for _, name, octets in asked),
        env={**os.environ, "LD_LIBRARY_PATH": str(place / "lib"), "PYTHONPATH": ""},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr[-2000:]
    answers = [line.split(" ", 1) for line in done.stdout.splitlines()]
    assert [name for name, _ in answers] == [name for _, name, _ in asked]
    compared: Counter[str] = Counter()
    for (cls, name, octets), (_, answer) in zip(asked, answers, strict=True):
        if answer == "absent" or name == MEANS_NOTHING:
            continue
        theirs = bytes.fromhex(answer)
        assert 0 <= len(theirs) - len(octets) <= MOST_BEHIND, name
        assert cls.decode(theirs, most_behind=MOST_BEHIND).encode() == octets, name
        compared[name] += 1
    assert len(compared) >= 70, sorted(compared)
