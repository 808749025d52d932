"""A robot's nodes, diagnostics, parameters, description and clock, in virtual time and in memory."""

from __future__ import annotations

import asyncio
from pathlib import Path

from msbot.ros.diagnostics import ERROR, OK, STALE, WARN
from msbot.ros.parameter_server import LONGEST_QUEUE, parameter_value
from msbot.ros2 import (
    Clock,
    DescribeParameters_Request,
    DescribeParameters_Response,
    DiagnosticArray,
    GetParameters_Request,
    GetParameters_Response,
    GetParameterTypes_Request,
    GetParameterTypes_Response,
    ListParameters_Request,
    ListParameters_Response,
    Log,
    Parameter,
    ParameterEvent,
    SetParameters_Request,
    SetParameters_Response,
    SetParametersAtomically_Request,
    SetParametersAtomically_Response,
    SetParametersResult,
    String,
)
from msbot_agent.space import Qos, Topic
from tests.operations.stage import AA_IS_A_DIAL, Stage, play
from tests.ros.ros_stage import RosStage

FIRST_TOPIC = 'topic = "HelloWorldTopic_1_to_2"'
IN_ROS = (FIRST_TOPIC, f"{FIRST_TOPIC}\nros = true")
"""AA publishes that topic, BB subscribes to it."""
WITH_CLOCK = ("[options]", "[ros]\nclock = true\n\n[options]")
READ_ONLY = ("[options]", '[ros]\nparameters = "read"\n\n[options]')
RING = ("AA=DIAL", "BB=EFGH")
AA = "/MSBOT_MASTER/AA"


def parameter(name: str, value: float | str | None) -> Parameter:
    return Parameter(name=name, value=parameter_value(value))


def test_parts_are_nodes_as_long_as_they_are_in_their_slots(tmp_path: Path) -> None:
    async def scene(stage: Stage) -> None:
        ros = RosStage(stage)
        await asyncio.sleep(0.1)
        assert ros.nodes() == ["/MSBOT_MASTER", AA, "/MSBOT_MASTER/BB"]  # CC is at no topic of ROS
        stage.pull("AA")
        await asyncio.sleep(8)
        assert ros.nodes() == ["/MSBOT_MASTER", "/MSBOT_MASTER/BB"]
        asked = ListParameters_Request(prefixes=[], depth=0)
        assert await ros.try_to_ask(AA, "list_parameters", asked, ListParameters_Response) is None
        ros.end()

    play(tmp_path, scene, AA_IS_A_DIAL, IN_ROS, parts=RING)


def test_a_robot_that_shares_nothing_with_ros_is_not_there(tmp_path: Path) -> None:
    async def scene(stage: Stage) -> None:
        ros = RosStage(stage)
        diagnostics = ros.listen("diagnostics", DiagnosticArray)
        await asyncio.sleep(3)
        assert diagnostics() == []
        ros.end()

    play(tmp_path, scene, AA_IS_A_DIAL, parts=RING)


def test_diagnostics_tell_every_slot_once_a_second(tmp_path: Path) -> None:
    async def scene(stage: Stage) -> None:
        ros = RosStage(stage)
        diagnostics = ros.listen("diagnostics", DiagnosticArray)
        await asyncio.sleep(3.5)
        assert len(diagnostics()) == 4
        assert [one.header.stamp.sec for one in diagnostics()] == [1, 2, 3, 4]
        status = {one.name: one for one in diagnostics()[-1].status}
        assert {name: one.level for name, one in status.items()} == {
            "MSBOT_MASTER": WARN,
            "MSBOT_MASTER: AA": OK,
            "MSBOT_MASTER: BB": OK,
            "MSBOT_MASTER: CC": STALE,
        }
        assert status["MSBOT_MASTER"].message == "without a part: CC"
        values = {pair.key: pair.value for pair in status["MSBOT_MASTER: AA"].values}
        assert (values["state"], values["part_number"]) == ("active", "DIAL")
        assert values["life"] == "3"
        assert values["reason"] in status["MSBOT_MASTER: AA"].message
        assert status["MSBOT_MASTER: AA"].hardware_id == "DIAL"  # no UID: that is for teachers
        stage.pull("BB")
        stage.master.say_stop("ann", "smoke")
        await asyncio.sleep(8)
        status = {one.name: one for one in diagnostics()[-1].status}
        assert (status["MSBOT_MASTER"].level, status["MSBOT_MASTER"].message) == (ERROR, "STOP, said by ann: smoke")
        assert status["MSBOT_MASTER: BB"].level == ERROR
        assert status["MSBOT_MASTER: BB"].message.startswith("lost: ")
        ros.end()

    play(tmp_path, scene, AA_IS_A_DIAL, IN_ROS, parts=RING)


def test_the_description_is_there_for_who_comes_later_and_the_clock_is_the_robots(tmp_path: Path) -> None:
    async def scene(stage: Stage) -> None:
        ros = RosStage(stage, description="<robot name='r'/>")
        await asyncio.sleep(1)
        assert [one.data for one in ros.listen("robot_description", String, late=True)()] == ["<robot name='r'/>"]
        nobody = ros.listen("/clock", Clock)
        clock = ros.listen("clock", Clock)
        began = stage.now()
        await asyncio.sleep(0.95)
        times = [one.clock.sec + one.clock.nanosec / 1e9 for one in clock()]
        assert len(times) in (9, 10)
        assert began <= times[0] < times[-1] <= stage.now()
        assert nobody() == []  # other robots have their own
        ros.end()

    play(tmp_path, scene, WITH_CLOCK)


def test_parameters_are_listed_described_and_read(tmp_path: Path) -> None:
    async def scene(stage: Stage) -> None:
        ros = RosStage(stage)
        await asyncio.sleep(0.1)
        names = await ros.ask(
            AA, "list_parameters", ListParameters_Request(prefixes=[], depth=0), ListParameters_Response
        )
        assert (names.result.names, names.result.prefixes) == (["period_s"], [])
        both = ["period_s", "nothing"]
        (known, unknown) = (
            await ros.ask(
                AA, "describe_parameters", DescribeParameters_Request(names=both), DescribeParameters_Response
            )
        ).descriptors
        assert (known.name, known.type, known.additional_constraints) == ("period_s", 3, "unit: s")
        assert [(one.from_value, one.to_value) for one in known.floating_point_range] == [(0.1, 10.0)]
        assert (unknown.name, unknown.type) == ("nothing", 0)
        types = await ros.ask(
            AA, "get_parameter_types", GetParameterTypes_Request(names=both), GetParameterTypes_Response
        )
        assert types.types == bytes([3, 0])
        values = await ros.ask(AA, "get_parameters", GetParameters_Request(names=both), GetParameters_Response)
        assert values.values == [parameter_value(1.0), parameter_value(None)]
        ros.end()

    play(tmp_path, scene, AA_IS_A_DIAL, IN_ROS, parts=RING)


def test_setting_a_parameter_is_msbot_set(tmp_path: Path) -> None:
    async def scene(stage: Stage) -> None:
        ros = RosStage(stage)
        events = ros.listen("/parameter_events", ParameterEvent)
        await asyncio.sleep(0.1)

        async def put(*wanted: Parameter) -> list[SetParametersResult]:
            asked = SetParameters_Request(parameters=list(wanted))
            return (await ros.ask(AA, "set_parameters", asked, SetParameters_Response)).results

        results = await put(
            parameter("period_s", 0.5), parameter("period_s", 99.0), parameter("x", 1.0), parameter("period_s", "soon")
        )
        assert [(one.successful, one.reason) for one in results] == [
            (True, ""),
            (False, "period_s: is 99.0; it must be 0.1 to 10 s"),
            (False, "slot AA has no parameter 'x'; there are period_s"),
            (False, "period_s is a double, not a string"),
        ]
        await asyncio.sleep(0.1)
        assert stage.parts["AA"].settings["period_s"] == "0.5"
        (edit,) = await stage.operations.undoing.read(50)
        assert (edit.who, edit.words) == ("ROS 2", "period_s of AA: 1 s -> 0.5 s")
        assert [one.successful for one in await put(Parameter(name="period_s", value=parameter_value(2)))] == [True]
        assert [one.successful for one in await put(parameter("period_s", None))] == [True]  # ros2 param delete
        await stage.do.set("AA", "period_s", "4", who="ann")
        await asyncio.sleep(0.1)
        told = [
            (one.node, [value.value.double_value for value in (*one.new_parameters, *one.changed_parameters)])
            for one in events()
        ]
        assert [values for node, values in told if node == AA] == [[1.0], [0.5], [2.0], [1.0], [4.0]]
        ros.end()

    play(tmp_path, scene, AA_IS_A_DIAL, IN_ROS, parts=RING)


def test_setting_together_is_all_or_nothing(tmp_path: Path) -> None:
    async def scene(stage: Stage) -> None:
        ros = RosStage(stage)
        await asyncio.sleep(0.1)

        async def put(*wanted: Parameter) -> tuple[bool, str]:
            asked = SetParametersAtomically_Request(parameters=list(wanted))
            reply = await ros.ask(AA, "set_parameters_atomically", asked, SetParametersAtomically_Response)
            return reply.result.successful, reply.result.reason

        assert await put(parameter("period_s", 0.5), parameter("gain", 99.0)) == (
            False,
            "gain: is 99.0; it must be 0 to 9",
        )
        assert await put(parameter("period_s", 0.5), parameter("period_s", 0.6)) == (
            False,
            "a parameter is named twice",
        )
        assert await put(parameter("period_s", 0.5), parameter("gain", None)) == (
            False,
            "gain of slot AA is not set by hand: its value is the library's already",
        )
        assert await stage.operations.undoing.read(50) == []
        assert await put(parameter("period_s", 0.5), parameter("gain", 3.0)) == (True, "")
        await asyncio.sleep(0.1)
        assert (stage.parts["AA"].settings["period_s"], stage.parts["AA"].settings["gain"]) == ("0.5", "3")
        assert len(await stage.operations.undoing.read(50)) == 2
        assert await put() == (True, "")
        ros.end()

    (tmp_path / "library").mkdir()
    (tmp_path / "library" / "MIXER.toml").write_text(MIXER)
    mixer = ('part = "ABCD"', 'part = "MIXER"')
    play(tmp_path, scene, mixer, IN_ROS, parts=("AA=MIXER",))


MIXER = """
number = "MIXER"
name = "Mixer"
[[port]]
name = "out"
direction = "publish"
type = "HelloWorld"
[[port]]
name = "in"
direction = "subscribe"
type = "HelloWorld"
[[parameter]]
name = "period_s"
type = "float"
default = 1.0
[[parameter]]
name = "gain"
type = "float"
default = 1.0
min = 0
max = 9
"""


def test_a_blueprint_may_let_ros_only_read(tmp_path: Path) -> None:
    async def scene(stage: Stage) -> None:
        ros = RosStage(stage)
        await asyncio.sleep(0.1)
        asked = SetParameters_Request(parameters=[parameter("period_s", 0.5)])
        (result,) = (await ros.ask(AA, "set_parameters", asked, SetParameters_Response)).results
        assert (
            result.reason
            == 'this robot lets ROS 2 only read parameters; [ros] parameters = "set" would let it set them'
        )
        values = await ros.ask(AA, "get_parameters", GetParameters_Request(names=["period_s"]), GetParameters_Response)
        assert values.values == [parameter_value(1.0)]
        assert await stage.operations.undoing.read(50) == []
        ros.end()

    play(tmp_path, scene, AA_IS_A_DIAL, IN_ROS, READ_ONLY, parts=RING)


def test_what_a_program_logs_is_in_rosout(tmp_path: Path) -> None:
    async def scene(stage: Stage) -> None:
        ros = RosStage(stage)
        lines = ros.listen("/rosout", Log)
        for level in ("info", "warning", "error"):
            stage.parts["AA"].log(f"it says {level}", level=level)
        await asyncio.sleep(1)
        assert [(one.level, one.name, one.msg) for one in lines()] == [
            (20, "MSBOT_MASTER.AA", "it says info"),
            (30, "MSBOT_MASTER.AA", "it says warning"),
            (40, "MSBOT_MASTER.AA", "it says error"),
        ]
        assert lines()[0].stamp.sec > 0
        ros.end()

    play(tmp_path, scene, AA_IS_A_DIAL, IN_ROS, parts=RING)


def test_what_the_master_itself_hears_is_the_robots_node(tmp_path: Path) -> None:
    """`ros2 topic info -v` shows no endpoint without a node."""

    async def scene(stage: Stage) -> None:
        ros = RosStage(stage)
        topic = Topic("rt/MSBOT_MASTER/anything", "T")
        ros.shared.reader(topic, Qos(reliable=False), lambda _: True)
        (shown,) = [endpoint.guid for endpoint in ros.shared.endpoints() if endpoint.name == topic.name]
        await asyncio.sleep(0.1)
        assert [node for node, readers in ros.readers().items() if shown in readers] == ["/MSBOT_MASTER"]
        ros.end()

    play(tmp_path, scene, AA_IS_A_DIAL, IN_ROS, parts=RING)


def test_nonsense_and_a_flood_get_no_answer_and_are_told_once(tmp_path: Path, caplog: object) -> None:
    async def scene(stage: Stage) -> None:
        ros = RosStage(stage)
        await asyncio.sleep(0.1)
        for _ in range(3):
            assert await ros.try_to_ask(AA, "get_parameters", b"\xff" * 7, GetParameters_Response) is None
        asked = ListParameters_Request(prefixes=[], depth=0)
        flood = [ros.try_to_ask(AA, "list_parameters", asked, ListParameters_Response) for _ in range(400)]
        answers = await asyncio.gather(*flood)
        assert LONGEST_QUEUE <= sum(answer is not None for answer in answers) < 400
        ros.end()

    play(tmp_path, scene, AA_IS_A_DIAL, IN_ROS, parts=RING)
    messages = [one.getMessage() for one in caplog.records if one.name == "msbot.ros.parameter_server"]  # type: ignore[attr-defined]
    assert [message.partition(" (")[0] for message in messages] == [
        "a request of ROS 2 about parameters is not answered: it makes no sense as "
        "rcl_interfaces::srv::dds_::GetParameters_Request_: "
        + messages[0].partition("GetParameters_Request_: ")[2].partition(" (")[0],
        f"a request of ROS 2 about parameters is not answered: {LONGEST_QUEUE} others wait: "
        "they come faster than the database answers",
    ]
