"""Prints what of ROS 2 works with which middleware, as the tests show it, and how long a service takes.

    python tools/ros_table.py             # the table
    python tools/ros_table.py --times     # the median of 500 calls of a genuine node, on a quiet computer

`rmw_fastrtps` is genuine ROS 2 Jazzy, in an environment that the tests make. `rmw_cyclonedds` cannot be had for Python:
Cyclone DDS with its header in front of requests and replies stands in for it.
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
import xml.etree.ElementTree as ET
from pathlib import Path

from msbot.runtime.event_loop import run_to_end

ROOT = Path(__file__).parent.parent
GENUINE, OURS = "tests.ros.genuine", "tests.space.dds"
CELLS = {
    "topics": (f"{GENUINE}.test_robot::test_nodes_topics_and_parameters",
               f"{OURS}.test_topics_in_dds::test_a_level_is_a_float32_for_ros_nodes_both_ways"),
    "nodes": (f"{GENUINE}.test_robot::test_nodes_topics_and_parameters",
              f"{OURS}.test_robot_for_ros::test_a_ros_node_finds_the_part_and_reads_and_sets_its_parameters"),
    "services": (f"{GENUINE}.test_services::test_a_board_serves_and_asks_nodes_of_both_kinds",
                 f"{OURS}.test_services::test_a_ros_node_asks_a_board"),
    "parameters": (f"{GENUINE}.test_robot::test_nodes_topics_and_parameters",
                   f"{OURS}.test_robot_for_ros::test_a_ros_node_finds_the_part_and_reads_and_sets_its_parameters"),
    "actions": (f"{GENUINE}.test_services::test_a_board_carries_out_an_action", ""),
}  # fmt: skip
"""The test that shows it, for each middleware; empty: none does."""


def main() -> None:
    """Print one or the other."""
    if "--times" in sys.argv:
        print(f"{run_to_end(median_ms()):.2f} ms")
        return
    passed = run(sorted({test for cells in CELLS.values() for test in cells if test}))
    print("| | `rmw_fastrtps` | `rmw_cyclonedds` |\n|---|---|---|")
    for what, cells in CELLS.items():
        print(f"| {what} | {' | '.join('not tried' if not test else passed.get(test, 'no') for test in cells)} |")


def run(tests: list[str]) -> dict[str, str]:
    """Which of the tests pass."""
    names = [f"{module.replace('.', '/')}.py::{test}" for module, test in (one.split("::") for one in tests)]
    with tempfile.TemporaryDirectory() as folder:
        report = Path(folder) / "report.xml"
        subprocess.run([sys.executable, "-m", "pytest", "-q", "-n", "0", f"--junitxml={report}", *names], cwd=ROOT,
                       check=False, stdout=sys.stderr)  # fmt: skip
        cases = ET.parse(report).iter("testcase")
        return {
            f"{case.get('classname')}::{case.get('name')}": "yes" if len(case) == 0 else case[0].tag for case in cases
        }


async def median_ms() -> float:
    """How long a call of a service takes that answers at once."""
    from msbot.space import Qos, Sample, Topic
    from msbot.space.dds import DdsSpace
    from tests.ros.genuine.node import genuine_node
    from tests.space.own_network import own_network

    with own_network(), DdsSpace() as space:
        kind = "std_srvs::srv::dds_::SetBool"
        service = Qos(depth=64, service=True)
        replies = space.writer(Topic("rr/switchReply", f"{kind}_Response_"), service, bytes(16))

        def answer(sample: Sample) -> bool:
            replies.write(b"\1\0\0\0\1\0\0\0\0", (sample.writer, sample.sequence_nr))
            return True

        space.reader(Topic("rq/switchRequest", f"{kind}_Request_"), service, answer)
        async with genuine_node() as node:
            told = await node.does("call", type="std_srvs/srv/SetBool", name="/switch", request={}, times=500)
            return float(told["median_ms"])


if __name__ == "__main__":
    sys.path.insert(0, str(ROOT))
    main()
