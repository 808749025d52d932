"""Services of parts in ROS 2, and services of nodes for parts: in virtual time and in memory."""

from __future__ import annotations

import asyncio
from pathlib import Path

import pytest

from msbot.config import Binding, Blueprint, RobotProfile, Slot, SlotPort, load_library
from msbot.config.blueprint.blueprint_model import NOBODY, InDds
from msbot.master.ros_services import SERVICE, ros_services
from msbot.operations.operation import Outcome
from msbot.part import HelloWorld
from msbot.ros.ros_log import ERROR
from msbot.ros.service_server import MOST_OPEN
from msbot.ros2 import Log, SetBool_Request, SetBool_Response, Trigger_Request, Trigger_Response
from msbot_agent.space import Sample, Topic, Writer
from msbot_xrce.errors import CallError, ConfigError
from tests.operations.stage import AA_IS_A_DIAL, Stage, play
from tests.ros.ros_stage import RosStage

SERVED = """[[binding]]
topic = "tell"
type = "HelloWorld -> HelloWorld"
from = "AA.echo"
to = []
ros = true
ros_type = "std_srvs/srv/SetBool"
ros_fields = { "request.index" = "data" }

[[binding]]
topic = "HelloWorldTopic_1_to_2\""""
"""AA serves what ROS 2 has as a SetBool: its `data` is our index, its `message` the text of our reply."""
CALLED = """[[binding]]
topic = "asked"
type = "HelloWorld -> HelloWorld"
from = ""
to = ["AA.ask"]
ros = true
ros_type = "std_srvs/srv/Trigger"
ros_topic = "/bell"

[[binding]]
topic = "HelloWorldTopic_1_to_2\""""
BEFORE = '[[binding]]\ntopic = "HelloWorldTopic_1_to_2"'
ROBOT = "/MSBOT_MASTER"
RING = ("AA=DIAL", "BB=EFGH")


def served(stage: Stage) -> None:
    """AA answers with what it was asked; the index 1 is refused."""
    stage.parts["AA"]._program.servers.clear()

    @stage.parts["AA"].serves("echo", HelloWorld, HelloWorld)
    def answer(request: HelloWorld) -> HelloWorld:
        if request.index:
            raise CallError("I am off")
        return HelloWorld(index=0, message=f"index {request.index}")


async def ask(ros: RosStage, *, data: bool) -> SetBool_Response | None:
    return await ros.try_to_ask(ROBOT, "tell", SetBool_Request(data=data), SetBool_Response)


def test_a_node_asks_a_part_and_gets_its_reply_or_its_sentence(tmp_path: Path) -> None:
    async def scene(stage: Stage) -> None:
        served(stage)
        ros = RosStage(stage)
        lines = ros.listen("/rosout", Log)
        assert await ask(ros, data=False) == SetBool_Response(success=True, message="index 0")
        assert lines() == []
        refused = "call of AA.echo: refused: I am off"
        assert await ask(ros, data=True) == SetBool_Response(success=False, message=refused)
        (line,) = lines()
        assert (line.level, line.name) == (ERROR, "MSBOT_MASTER.AA")
        assert line.msg == f"request of ROS 2 to {ROBOT}/tell: {refused}"
        told = (await stage.do.log_lines(who="ann")).answer["lines"]
        assert isinstance(told, list)
        said = [(one["slot"], one["words"]) for one in told if one["who"] == "ROS 2"]
        assert said == [("AA", "ROS 2: AA.echo: index 0, message index 0")]
        ros.end()

    play(tmp_path, scene, AA_IS_A_DIAL, (BEFORE, SERVED), parts=RING)


@pytest.mark.promise("STOP holds for services, whoever asks")
def test_stop_frozen_classes_and_missing_parts_hold_for_nodes_of_ros(tmp_path: Path) -> None:
    async def scene(stage: Stage) -> None:
        served(stage)
        ros = RosStage(stage)
        stage.master.say_stop("ann")
        await asyncio.sleep(1)
        told = await ask(ros, data=False)
        assert told == SetBool_Response(success=False, message="call of AA.echo: STOP is in force: call again after GO")
        stage.master.say_go("ann")
        await stage.do.freeze("listen", who="ann")
        told = await ask(ros, data=False)
        assert told is not None
        assert not told.success
        assert "ann has stopped the class" in told.message or "frozen" in told.message, told.message
        await stage.do.thaw(who="ann")
        assert await ask(ros, data=False) == SetBool_Response(success=True, message="index 0")
        stage.pull("AA")
        await asyncio.sleep(8)
        assert await ask(ros, data=False) is None, "nothing offers it any more"
        ros.end()

    play(tmp_path, scene, AA_IS_A_DIAL, (BEFORE, SERVED), parts=RING)


def test_a_flood_leaves_calls_for_people(tmp_path: Path) -> None:
    async def scene(stage: Stage) -> None:
        membership = stage.parts["AA"]._runner._membership
        assert membership is not None
        deaf, membership.client._on_request = membership.client._on_request, lambda *_: None
        ros = RosStage(stage)
        told = await asyncio.gather(*(ask(ros, data=False) for _ in range(MOST_OPEN + 2)))
        assert [one for one in told if one is not None] == [
            SetBool_Response(success=False, message=f"{MOST_OPEN} requests of ROS 2 wait for replies already")
        ] * 2
        membership.client._on_request = deaf
        done: Outcome = await stage.do.call("AA.echo", ["index=0", "message=x"], who="ann")
        assert done.answer == {"reply": {"index": 0, "message": "x"}}
        ros.end()

    play(tmp_path, scene, AA_IS_A_DIAL, (BEFORE, SERVED), parts=RING)


def node_that_serves(ros: RosStage, name: str, answers: list[Trigger_Response]) -> list[bytes]:
    """A node of ROS 2 that answers with these, one after the other, then no more."""
    asked: list[bytes] = []
    ends: list[Writer] = []

    def take(sample: Sample) -> bool:
        asked.append(sample.payload)
        if answers:
            ends[0].write(answers.pop(0).encode(), (sample.writer, sample.sequence_nr))
        return True

    ends.append(ros.space.writer(Topic(f"rr{name}Reply", Trigger_Response.type_name), SERVICE, b"a node of ROS 2."))
    ros.space.reader(Topic(f"rq{name}Request", Trigger_Request.type_name), SERVICE, take)
    return asked


def test_a_part_asks_a_node(tmp_path: Path) -> None:
    async def scene(stage: Stage) -> None:
        ros = RosStage(stage)
        answers = [Trigger_Response(success=True, message="dong"), Trigger_Response(success=False, message="no bell")]
        part = stage.parts["AA"]
        part.calls("ask", HelloWorld, HelloWorld)
        heard: list[object] = []

        async def call() -> object:
            part.call(
                "ask",
                HelloWorld(index=1, message="x"),
                timeout=1.0,
                on_reply=lambda reply, error: heard.append(error or reply),
            )
            await asyncio.sleep(1.5)
            return heard.pop()

        words = "no node of ROS 2 serves /bell now: `ros2 service list` shows those that do"
        assert await call() == f"call of ask: the robot does not pass it on: {words}"
        asked = node_that_serves(ros, "/bell", answers)
        assert await call() == HelloWorld(index=0, message="dong")
        assert await call() == "call of ask: refused: no bell"
        assert "no reply within 1 s" in str(await call())
        stage.master.say_stop("ann")
        assert await call() == "call of ask: STOP is in force: call again after GO"
        assert asked == [Trigger_Request(structure_needs_at_least_one_member=0).encode()] * 3
        ros.end()

    play(tmp_path, scene, AA_IS_A_DIAL, (BEFORE, CALLED), parts=RING)


@pytest.mark.parametrize(
    ("ros_type", "fields", "words"),
    [
        ("", {}, "HelloWorld -> HelloWorld has no usual service type in ROS 2: say ros_type"),
        ("std_srvs/srv/SetBol", {}, "there is no such service type in std_srvs; there are Empty, SetBool, Trigger"),
        ("SetBool", {}, "'SetBool' is not a service type of ROS 2: write it like std_srvs/srv/SetBool"),
        ("std_srvs/SetBool", {}, "have no field of the same name: say ros_fields"),
        (
            "std_srvs/SetBool",
            {"message": "data"},
            "request and reply have a field 'message': write request.message or reply.message in ros_fields",
        ),
        ("std_srvs/SetBool", {"value": "data"}, "ros_fields names 'value'; request and"),
        (
            "my_robot/srv/Tell",
            {"request.index": "data"},
            "my_robot/srv/Tell is not among the service types that MsBOT knows",
        ),
    ],
)
def test_what_has_no_form_in_ros_is_refused_before_the_robot_runs(
    ros_type: str, fields: dict[str, str], words: str
) -> None:
    wish = InDds(ros=True, ros_type=ros_type, ros_fields=tuple(fields.items()))
    wire = Binding("tell", "HelloWorld -> HelloWorld", NOBODY, (SlotPort("eye", "ask"),), in_dds=wish)
    robot = Blueprint(RobotProfile("R", "1", "1"), (Slot("eye", "EYE"),), (wire,))
    with pytest.raises(ConfigError) as raised:
        ros_services(robot, load_library())
    assert str(raised.value).startswith('the binding of "tell" with ros = true: ')
    assert words in str(raised.value)
