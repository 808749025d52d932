"""`msbot class stop` tells each robot once, however it was reached."""

from __future__ import annotations

from msbot_school.cli.classroom.class_commands import not_here

ROVER = {"robot": "ROVER", "serial_number": "R-1"}


def test_a_robot_here_that_also_has_an_access_is_told_once() -> None:
    here = [ROVER | {"stopped": True}]
    far = [ROVER | {"page": "http://a", "stopped": True}, {"robot": "RING", "serial_number": "R-1", "stopped": True}]
    assert not_here(far, here) == far[1:]


def test_one_that_has_not_stopped_is_told_in_any_case() -> None:
    refused = ROVER | {"page": "http://a", "stopped": False, "error": "NOT told: no answer"}
    assert not_here([refused], [ROVER | {"stopped": True}]) == [refused]
    stopped = ROVER | {"page": "http://a", "stopped": True}
    assert not_here([stopped], [ROVER | {"stopped": False}]) == [stopped]
