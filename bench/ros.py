"""What of ROS 2 works with which middleware, as the tests show it, and how long it takes.

    python -m bench.ros [--write] [--times 300]

Runs tests.ros.genuine: genuine ROS 2 Jazzy in an environment that the tests make, in a network of its own. Its packages
have `rmw_fastrtps` only. Whoever has built `librmw_cyclonedds_cpp.so` for them names it in MSBOT_RMW_CYCLONEDDS, and
both middlewares are genuine; without it, Cyclone DDS with its header in front of requests and replies stands in for
`rmw_cyclonedds`, and the table says so.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import tempfile
import xml.etree.ElementTree as ET
from datetime import UTC, datetime
from pathlib import Path
from struct import pack

from bench.machine import describe_machine
from bench.result import write_result
from msbot_agent.process.end_signals import run_to_end
from msbot_agent.space import Qos, Sample, Topic
from msbot_agent.space.dds import DdsSpace
from tests.ros.genuine.environment import MIDDLEWARES, environment
from tests.ros.genuine.node import Node, genuine_node
from tests.ros.genuine.robots import robot
from tests.ros.genuine.test_services import board, fibonacci
from tests.space.own_network import own_network

ROOT = Path(__file__).parent.parent
GENUINE, MODEL = "tests.ros.genuine", "tests.space.dds"
FASTRTPS, CYCLONE = "rmw_fastrtps_cpp", "rmw_cyclonedds_cpp"
SHOWN = {
    "topics": [f"{GENUINE}.test_topics", f"{GENUINE}.test_robot::test_what_a_node_publishes_moves_the_fan"],
    "nodes": [
        f"{GENUINE}.test_robot::test_nodes_topics_and_parameters",
        f"{GENUINE}.test_robot::test_a_robot_is_found_again_when_either_side_starts_again",
    ],
    "services": [
        f"{GENUINE}.test_services::test_a_board_serves_and_asks_nodes_of_both_kinds",
        f"{GENUINE}.test_services::test_a_service_is_found_again_after_a_restart_of_its_agent",
        f"{GENUINE}.test_services::test_a_board_finds_a_service_again_after_a_restart_of_its_node",
    ],
    "parameters": [f"{GENUINE}.test_robot::test_nodes_topics_and_parameters"],
    "actions": [
        f"{GENUINE}.test_services::test_a_board_carries_out_an_action",
        f"{GENUINE}.test_services::test_a_board_asks_for_an_action_of_a_node",
    ],
    "bags": [f"{GENUINE}.test_bag"],
    "standard types": [f"{GENUINE}.test_standard_types"],
    "types of ros-package": [f"{GENUINE}.test_package_types"],
    "services of parts": [f"{GENUINE}.test_part_services"],
}
"""The tests that show it: all of a file, or all with this name."""
STAND_IN = {
    "topics": f"{MODEL}.test_topics_in_dds::test_a_level_is_a_float32_for_ros_nodes_both_ways",
    "nodes": f"{MODEL}.test_robot_for_ros::test_a_ros_node_finds_the_part_and_reads_and_sets_its_parameters",
    "services": f"{MODEL}.test_services::test_a_ros_node_asks_a_board",
    "parameters": f"{MODEL}.test_robot_for_ros::test_a_ros_node_finds_the_part_and_reads_and_sets_its_parameters",
}
"""The test with the model of rmw_cyclonedds."""


def main() -> int:
    """Run, measure, print, write."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--write", action="store_true", help="put the table into bench/results/ros.md")
    parser.add_argument("--times", type=int, default=300, help="so many of each are timed (default: 300)")
    options = parser.parse_args()
    passed = run([ROOT / "packages/msbot/tests/ros/genuine", *sorted({_file(test) for test in STAND_IN.values()})])
    times = {middleware: run_to_end(medians(middleware, options.times)) for middleware in MIDDLEWARES}
    lines = table(passed, times)
    print("\n".join(lines))
    if options.write:
        write_result("ros", "ROS 2 by middleware", lines, made_by="python -m bench.ros --write")
    return 0 if not any("**no**" in line for line in lines) else 1


def table(passed: dict[str, bool], times: dict[str, dict[str, float]]) -> list[str]:
    """The table in Markdown."""
    genuine = "genuine" if CYCLONE in MIDDLEWARES else "a stand-in"
    lines = [
        f"{datetime.now(UTC):%d %B %Y}, {describe_machine()}. rclpy {_version('rclpy')}, "
        f"rmw_fastrtps {_version('rmw-fastrtps-cpp')}; rmw_cyclonedds: {genuine}.",
        "",
        "| | `rmw_fastrtps` | median | `rmw_cyclonedds` | median |",
        "|---|---|---|---|---|",
    ]
    for what, tests in SHOWN.items():
        cells = [what]
        for middleware in (FASTRTPS, CYCLONE):
            cells.append(_cell(passed, tests, middleware, STAND_IN.get(what)))
            median = times.get(middleware, {}).get(what)
            cells.append("" if median is None else f"{median:.1f} ms")
        lines.append(f"| {' | '.join(cells)} |")
    return [
        *lines,
        "",
        "Medians: a number there and back (topics), a call answered at once (services), a value read "
        "(parameters), a goal with its result (actions).",
    ]


def _cell(passed: dict[str, bool], tests: list[str], middleware: str, stand_in: str | None) -> str:
    if middleware in MIDDLEWARES:
        found = [ok for name, ok in passed.items() if any(_is(name, test) for test in tests) and middleware in name]
    else:
        found = [ok for name, ok in passed.items() if stand_in is not None and _is(name, stand_in)]
    return "not tried" if not found else f"yes ({len(found)} tests)" if all(found) else "**no**"


def _is(name: str, test: str) -> bool:
    return name.partition("[")[0] == test or name.partition("::")[0] == test


def _file(test: str) -> Path:
    """Where a test of a distribution lies: `tests.space.dds...` is in one of the packages."""
    name = f"{test.partition('::')[0].replace('.', '/')}.py"
    (found,) = ROOT.glob(f"packages/*/{name}")
    return found


def run(paths: list[Path]) -> dict[str, bool]:
    """Which of the tests pass; a skipped one is absent."""
    with tempfile.TemporaryDirectory() as folder:
        report = Path(folder) / "report.xml"
        subprocess.run(
            [sys.executable, "-m", "pytest", "-q", "-n", "0", f"--junitxml={report}", *map(str, paths)],
            cwd=ROOT,
            check=False,
            stdout=sys.stderr,
        )
        passed = {
            f"tests.{(case.get('classname') or '').partition('tests.')[2]}::{case.get('name')}": len(case) == 0
            for case in ET.parse(report).iter("testcase")
            if case.find("skipped") is None
        }
    if not passed:
        raise SystemExit("none of the tests ran; pytest says above why")
    return passed


async def medians(middleware: str, times: int) -> dict[str, float]:
    """How long each takes, in milliseconds."""
    found = {}
    with own_network(), tempfile.TemporaryDirectory() as folder:
        async with genuine_node(middleware=middleware) as node:
            with DdsSpace() as space:
                for what, ask in (("topics", _ping), ("services", _call)):
                    found[what] = await ask(space, node, times)
                async with board(space) as (client, participant), fibonacci(client, participant):
                    told = await node.does(
                        "send_goal",
                        type="test_msgs/action/Fibonacci",
                        name="/fibonacci",
                        goal={"order": 3},
                        times=times,
                    )
                    found["actions"] = told["median_ms"]
            async with robot(Path(folder)):
                told = await node.does(
                    "call",
                    type="rcl_interfaces/srv/GetParameters",
                    name="/ROVER/knob/get_parameters",
                    request={"names": ["period_s"]},
                    times=times,
                )
                found["parameters"] = told["median_ms"]
    return found


async def _ping(space: DdsSpace, node: Node, times: int) -> float:
    qos = Qos(depth=10, partitions=("",))
    back = space.writer(Topic("rt/pong", "std_msgs::msg::dds_::Int32_"), qos, bytes(16))

    def answer(sample: Sample) -> bool:
        back.write(sample.payload)
        return True

    space.reader(Topic("rt/ping", "std_msgs::msg::dds_::Int32_"), qos, answer)
    told = await node.does("ping", there="/ping", back="/pong", times=times)
    return float(told["median_ms"])


async def _call(space: DdsSpace, node: Node, times: int) -> float:
    kind = "std_srvs::srv::dds_::SetBool"
    service = Qos(depth=64, service=True)
    replies = space.writer(Topic("rr/switchReply", f"{kind}_Response_"), service, bytes(15) + b"\1")

    def answer(sample: Sample) -> bool:
        replies.write(pack("<?3xIB", True, 1, 0), (sample.writer, sample.sequence_nr))
        return True

    space.reader(Topic("rq/switchRequest", f"{kind}_Request_"), service, answer)
    told = await node.does("call", type="std_srvs/srv/SetBool", name="/switch", request={}, times=times)
    return float(told["median_ms"])


def _version(package: str) -> str:
    done = subprocess.run(
        [str(environment() / "bin/python"), "-c", f"import importlib.metadata as m; print(m.version('ros-{package}'))"],
        capture_output=True,
        text=True,
        check=True,
    )
    return done.stdout.strip()


if __name__ == "__main__":
    sys.exit(main())
