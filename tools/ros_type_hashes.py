"""Writes `packages/msbot-agent/src/msbot_agent/space/dds/ros_type_hashes.py` from the `share` folder of a ROS 2
installation.

python tools/ros_type_hashes.py build/kept/ros-jazzy/*/ros/share
"""

from __future__ import annotations

import json
import sys
from collections.abc import Iterator
from pathlib import Path

from msbot.ros2.known_types import ROS_TYPES

TARGET = Path(__file__).parent.parent / "packages/msbot-agent/src/msbot_agent/space/dds/ros_type_hashes.py"
BESIDE = ("rmw_dds_common::msg::dds_::ParticipantEntitiesInfo_",)
"""Types that have no class of ours."""
BEGIN, END = "ROS_TYPE_HASHES = {\n", "\n}\n"


def found(share: Path) -> Iterator[tuple[str, str]]:
    """Types as DDS names them, with their hashes."""
    for path in sorted(share.glob("*/*/*.json")):
        package, kind, stem = (*path.parts[-3:-1], path.stem)
        wanted = [f"{stem}_Request", f"{stem}_Response"] if kind == "srv" else [stem]
        for one in json.loads(path.read_text()).get("type_hashes", ()):
            for name in wanted:
                if one["type_name"] == f"{package}/{kind}/{name}":
                    yield f"{package}::{kind}::dds_::{name}_", one["hash_string"].removeprefix("RIHS01_")


def text(share: Path, now: str) -> str:
    """The file with another table."""
    hashes = dict(found(share))
    lines = [f'    "{name}": "{hashes[name]}",' for name in sorted({*ROS_TYPES, *BESIDE}) if name in hashes]
    head, _, rest = now.partition(BEGIN)
    return head + BEGIN + "\n".join(lines) + END + rest.partition(END)[2]


if __name__ == "__main__":
    TARGET.write_text(text(Path(sys.argv[1]), TARGET.read_text()))
