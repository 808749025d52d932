"""The safe state: safe values go to the ports' own functions, STOP holds until GO."""

from __future__ import annotations

import logging
from collections.abc import Callable

import pytest
from hypothesis import given
from hypothesis import strategies as st

from msbot.part.handler_guard import Guard
from msbot.part.messages.message import Message
from msbot.part.messages.standard import HelloWorld
from msbot.part.messages.wire_types import float32, int16, uint8
from msbot.part.program import Listener
from msbot.part.safe_state import Safety, safe_message
from msbot.process.virtual_time import run_virtual
from msbot_xrce.errors import ConfigError, LocalProtocolError


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
        scene.safety.change_master(is_there=True)
        scene.safety.stop("on the bus")
        scene.safety.stop("on the bus")
        scene.safety.go(1)
        assert not scene.safety.stopped

    play(scenario)


def test_a_stop_that_the_master_heard_before_it_was_asked_is_over_unless_it_holds_there(
    caplog: pytest.LogCaptureFixture,
) -> None:
    def scenario(scene: Scene) -> None:
        safety = scene.safety
        safety.change_master(is_there=True)
        safety.ask()
        assert not safety.no_stop_holds(), "there was none"
        safety.stop("on the bus")
        safety.ask()
        assert not safety.beats, "the answer is on its way"
        assert safety.no_stop_holds()
        assert (safety.stopped, safety.number) == (False, 0)
        assert "GO: no STOP holds in the robot" in caplog.text
        assert not safety.no_stop_holds(), "it is said once"

        safety.stop("on the bus")
        safety.ask()
        safety.stop("it holds in the robot that the part has joined", 3)
        assert not safety.no_stop_holds(), "a later configuration names none"
        assert safety.stopped
        assert safety.go(3)

        safety.ask()
        safety.stop("on the bus, while the answer is on its way")
        assert not safety.no_stop_holds()
        assert safety.stopped
        assert safety.go(4)

        safety.stop("on the bus")
        safety.ask()
        safety.change_master(is_there=True)
        assert not safety.no_stop_holds(), "it was asked in another session"
        assert safety.stopped

    play(scenario)


def test_a_stop_on_the_bus_without_a_master_ends_only_after_a_master_has_said_it() -> None:
    def scenario(scene: Scene) -> None:
        safety = scene.safety
        safety.stop("on the bus")
        safety.change_master(is_there=True)
        safety.ask()
        assert [*safety.beats] == [0], "the master must take it up"
        assert not safety.no_stop_holds()
        assert not safety.go(7), "of one that was over before"
        assert safety.stopped
        safety.stop("the master has taken it up", 8)
        assert [*safety.beats] == [8]
        assert not safety.go(7)
        assert safety.go(8)
        assert not safety.beats

    play(scenario)


def test_a_numbered_stop_goes_on_until_its_robot_says_that_it_is_over() -> None:
    def scenario(scene: Scene) -> None:
        safety = scene.safety
        safety.recognise("rover")
        safety.stop("button", 5)
        safety.leave()
        safety.change_master(is_there=False)
        safety.change_master(is_there=True)
        assert not safety.recognise("rover")
        safety.ask()
        assert [*safety.beats] == [5]
        assert not safety.no_stop_holds(), "the master may never have heard of it"
        assert not safety.go(4)
        assert safety.go(6)

        safety.stop("button", 7)
        safety.change_master(is_there=False)
        safety.stop("on the bus")
        safety.change_master(is_there=True)
        safety.ask()
        assert [*safety.beats] == [0], "it is a later one"

    play(scenario)


def test_another_robot_has_nothing_to_do_with_a_numbered_stop_but_with_one_on_its_bus() -> None:
    def scenario(scene: Scene) -> None:
        safety = scene.safety
        safety.recognise("rover")
        safety.stop("button", 5)
        safety.change_master(is_there=True)
        assert safety.recognise("arm")
        assert not safety.stopped
        safety.change_master(is_there=False)
        safety.stop("on the bus")
        safety.change_master(is_there=True)
        assert not safety.recognise("rover")
        assert safety.stopped

    play(scenario)


def test_a_part_that_is_not_safe_never_confirms_a_stop_that_it_has_brought_along() -> None:
    def scenario(scene: Scene) -> None:
        def fails() -> None:
            raise OSError("stuck")

        safety = scene.safety
        scene.functions.append(fails)
        safety.stop("button", 5)
        assert not safety.beats, "the master tells it again"
        safety.leave()
        safety.change_master(is_there=True)
        safety.ask()
        assert [*safety.beats] == [0]
        scene.functions.remove(fails)
        safety.stop("told again", 5)
        assert [*safety.beats] == [5]

    play(scenario)


def test_a_button_that_is_pressed_says_stop_with_every_beat_beside_the_confirmation() -> None:
    def scenario(scene: Scene) -> None:
        safety = scene.safety
        safety.change_master(is_there=True)
        safety.is_held = True
        assert not safety.beats, "nobody has said STOP"
        safety.stop("the button")
        assert [*safety.beats] == [0]
        safety.stop("told", 3)
        assert [*safety.beats] == [3, 0]
        safety.is_held = False
        assert [*safety.beats] == [3]

    play(scenario)


@given(st.lists(st.sampled_from(["bus", "number", "old number", "ask", "none", "go", "lost", "found"]), max_size=12))
def test_stop_ends_only_by_a_newer_go_or_by_the_answer_of_the_master_that_knew_of_it(steps: list[str]) -> None:
    """A plain model: whether STOP holds, whether the present master knows of it, and whether it was asked since."""

    def scenario(scene: Scene) -> None:
        safety = scene.safety
        number, over, holds, is_there, knows, is_asked, told = 0, 0, False, False, False, False, False
        for step in steps:
            match step:
                case "bus":
                    safety.stop("on the bus")
                    holds, is_asked, told, knows = True, False, False, is_there
                case "number":
                    number += 1
                    safety.stop("said by the master", number)
                    holds, is_asked, told, knows = True, False, True, True
                case "old number" if over:
                    safety.stop("a repetition", over)
                case "ask":
                    safety.ask()
                    is_asked = holds and knows
                case "none":
                    assert safety.no_stop_holds() is (holds and is_asked)
                    holds = holds and not is_asked
                case "go":
                    number = number + 1  # newer than anything
                    over = number
                    ends = holds and (told or knows)
                    assert safety.go(number) is ends
                    holds = holds and not ends
                case "lost" | "found":
                    is_there = step == "found"
                    safety.change_master(is_there=is_there)
                    number, over, knows, is_asked = (number if told else 0), 0, False, False
            if not holds:
                is_asked = knows = told = False
            assert safety.stopped is holds
            if holds and not told and not (knows and is_asked):
                assert [*safety.beats] == [0]

    play(scenario)


def test_a_part_that_starts_anew_knows_of_no_stop() -> None:
    def scenario(scene: Scene) -> None:
        scene.safety.stop("button", 7)
        scene.safety.leave()
        assert scene.story == ["safe", "safe"]
        assert scene.safety.stopped
        scene.safety.forget_stop()
        assert not scene.safety.stopped
        assert scene.safety.stop("another master's first", 1)

    play(scenario)
