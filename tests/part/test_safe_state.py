"""The safe state: safe values go to the ports' own functions, STOP holds until GO."""

from __future__ import annotations

import logging
from collections.abc import Callable

import pytest
from hypothesis import given
from hypothesis import strategies as st

from msbot.errors import ConfigError, LocalProtocolError
from msbot.part.handler_guard import Guard
from msbot.part.messages.hello import HelloWorld
from msbot.part.messages.message import Message
from msbot.part.messages.wire_types import float32, int16, uint8
from msbot.part.program import Listener
from msbot.part.safe_state import Safety, safe_message
from msbot.runtime.virtual_time import run_virtual


class Motor(Message):
    """Something with fields of every simple kind."""

    speed: float32 = 1.0
    gear: int16 = 0
    brake: bool = False
    note: str = ""
    rest: list[uint8] = []  # noqa: RUF012 - copied for each message


class Scene:
    """A motor, a lamp, and what happened to them."""

    def __init__(self) -> None:
        self.story: list[object] = []
        listeners = {"motor": Listener(Motor, self.story.append), "lamp": Listener(HelloWorld, self.story.append)}
        self.functions: list[Callable[[], object]] = [lambda: self.story.append("safe")]
        self.safety = Safety(listeners, self.functions, Guard(lambda _: None))


def play(scenario: Callable[[Scene], None]) -> None:
    async def main() -> None:
        scenario(Scene())

    run_virtual(main())


def test_fields_are_read_as_what_they_are_and_the_others_have_their_defaults() -> None:
    message = safe_message(Motor, {"gear": "-3", "brake": "true", "note": "parked"})
    assert message == Motor(speed=1.0, gear=-3, brake=True, note="parked", rest=[])
    assert safe_message(Motor, {}) == Motor()


@pytest.mark.parametrize("fields", [{"pace": "0"}, {"rest": "0"}, {"gear": "1.5"}, {"brake": "no"}])
def test_what_does_not_fit_the_message_is_an_error(fields: dict[str, str]) -> None:
    with pytest.raises(ConfigError):
        safe_message(Motor, fields)
    with pytest.raises(LocalProtocolError):
        safe_message(Motor, {"gear": "70000"})


def test_all_ports_get_their_safe_value_then_the_functions_are_called() -> None:
    def scenario(scene: Scene) -> None:
        scene.safety.configure({"motor.safe.speed": "0", "motor.safe.brake": "true", "lamp.safe.message": "off"})
        scene.safety.enter()
        assert scene.story == [Motor(speed=0.0, brake=True), HelloWorld(index=0, message="off"), "safe"]

    play(scenario)


def test_one_port_alone_gets_its_safe_value() -> None:
    def scenario(scene: Scene) -> None:
        scene.safety.configure({"motor.safe.speed": "0", "lamp.safe.message": "off"})
        scene.safety.enter("lamp")
        assert scene.story == [HelloWorld(index=0, message="off"), "safe"]
        scene.safety.configure({})
        scene.safety.enter()
        assert scene.story[2:] == ["safe"]

    play(scenario)


def test_a_port_without_a_function_drives_nothing_and_a_misfit_is_reported(caplog: pytest.LogCaptureFixture) -> None:
    def scenario(scene: Scene) -> None:
        scene.safety.configure({"other.safe.value": "0", "motor.safe.pace": "0", "lamp.safe.index": "-1"})
        scene.safety.enter()
        assert scene.story == ["safe"]

    with caplog.at_level(logging.ERROR):
        play(scenario)
    assert [record.getMessage().partition(":")[0] for record in caplog.records] == [
        "safe value of port 'motor'",
        "safe value of port 'lamp'",
    ]


def test_stop_holds_until_go() -> None:
    def scenario(scene: Scene) -> None:
        safety = scene.safety
        assert not safety.stopped
        safety.go(0)
        assert safety.stop("button", 1)
        assert not safety.stop("button", 1), "repeated"
        assert safety.stopped
        assert scene.story == ["safe"]
        safety.go(1)
        assert not safety.stopped
        assert not safety.stop("button", 1), "a repetition that was overtaken by GO"
        assert not safety.stopped
        assert safety.stop("button", 2)

    play(scenario)


def test_a_function_that_fails_keeps_the_part_from_confirming_until_it_works() -> None:
    def scenario(scene: Scene) -> None:
        broken = [True]

        def let_go() -> None:
            if broken[0]:
                raise RuntimeError("the brake is stuck")

        scene.functions.append(let_go)
        assert scene.safety.stop("button", 1)
        assert scene.safety.stopped
        assert scene.safety.number == 0, "nobody knows whether it is safe"
        broken[0] = False
        assert not scene.safety.stop("button", 1)
        assert scene.safety.number == 1
        assert scene.safety.go(1)
        assert scene.safety.number == 0

    play(scenario)


def test_stop_said_again_on_the_bus_does_not_outlive_the_go_of_the_master() -> None:
    def scenario(scene: Scene) -> None:
        safety = scene.safety
        safety.stop("on the bus")
        safety.stop("the master has taken it up", 1)
        assert safety.number == 1
        safety.stop("on the bus, again")
        assert safety.number == 0, "the master must say once more which STOP holds"
        safety.stop("repeated with the answer to the next beat", 1)
        assert safety.number == 1
        assert safety.go(1)
        assert not safety.stopped

    play(scenario)


def test_the_go_of_an_earlier_stop_does_not_end_the_one_that_was_said_on_the_bus_meanwhile() -> None:
    def scenario(scene: Scene) -> None:
        safety = scene.safety
        safety.stop("button", 1)
        safety.go(1)
        assert safety.stop("on the bus")
        safety.go(1)
        assert safety.stopped
        assert not safety.stop("the master has taken it up", 2)
        safety.go(1)
        assert safety.stopped
        safety.go(2)
        assert not safety.stopped

    play(scenario)


def test_a_stop_on_the_bus_whose_notice_was_lost_ends_with_the_next_go() -> None:
    def scenario(scene: Scene) -> None:
        scene.safety.stop("on the bus")
        scene.safety.stop("on the bus")
        scene.safety.go(1)
        assert not scene.safety.stopped

    play(scenario)


def test_a_stop_that_was_heard_before_the_robot_was_asked_is_over_unless_it_holds_there(
    caplog: pytest.LogCaptureFixture,
) -> None:
    def scenario(scene: Scene) -> None:
        safety = scene.safety
        safety.ask()
        assert not safety.none_holds(), "there was none"
        safety.stop("on the bus")
        safety.ask()
        assert safety.none_holds()
        assert (safety.stopped, safety.number) == (False, 0)
        assert "GO: no STOP holds in the robot" in caplog.text
        assert not safety.none_holds(), "it is said once"

        safety.stop("on the bus")
        safety.ask()
        safety.stop("it holds in the robot that the part has joined", 3)
        assert not safety.none_holds(), "a later configuration names none"
        assert safety.stopped
        assert safety.go(3)

        safety.ask()
        safety.stop("on the bus, while the answer is on its way")
        assert not safety.none_holds()
        assert safety.stopped
        assert safety.go(4)

        safety.stop("on the bus")
        safety.ask()
        safety.leave()
        safety.stop("on the bus")
        assert not safety.none_holds(), "it was asked in another session"
        assert safety.stopped

    play(scenario)


@given(st.lists(st.sampled_from(["bus", "number", "old number", "ask", "none", "go", "leave"]), max_size=12))
def test_nothing_said_after_the_question_is_ended_by_its_answer(steps: list[str]) -> None:
    """A plain model: whether STOP holds, and whether all that was heard of it was heard before the question."""

    def scenario(scene: Scene) -> None:
        safety = scene.safety
        number, over, holds, is_before = 0, 0, False, False
        for step in steps:
            match step:
                case "bus":
                    safety.stop("on the bus")
                    holds, is_before = True, False
                case "number":
                    number += 1
                    safety.stop("said by the master", number)
                    holds, is_before = True, False
                case "old number" if over:
                    safety.stop("a repetition", over)
                case "ask":
                    safety.ask()
                    is_before = holds
                case "none":
                    assert safety.none_holds() is is_before
                    if is_before:
                        holds = is_before = False
                case "go":
                    number = number + 1  # newer than anything
                    over = number
                    safety.go(number)
                    holds = False
                case "leave":
                    safety.leave()
                    number, over, holds, is_before = 0, 0, False, False
            if not holds:
                is_before = False
            assert safety.stopped is holds

    play(scenario)


def test_a_part_that_is_out_of_its_robot_is_safe_and_free_of_what_was_said_there() -> None:
    def scenario(scene: Scene) -> None:
        scene.safety.stop("button", 7)
        scene.safety.leave()
        assert not scene.safety.stopped
        assert scene.story == ["safe", "safe"]
        assert scene.safety.stop("another master's first", 1)

    play(scenario)
