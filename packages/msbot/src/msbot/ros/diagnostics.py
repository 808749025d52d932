"""The state of a robot as `diagnostic_msgs/DiagnosticArray`: a status for the robot and one for each slot."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

from msbot.pnp import PartInfo, PartState
from msbot.pnp.emergency_stop import StopStatus
from msbot.ros2 import DiagnosticArray, DiagnosticStatus, Header, KeyValue, Time

OK, WARN, ERROR, STALE = range(4)
"""Levels of `diagnostic_msgs/DiagnosticStatus`. STALE: nothing is known (any more)."""

_LEVELS = {
    PartState.ACTIVE: OK,
    PartState.LATE: WARN,
    PartState.LOST: ERROR,
    PartState.LEFT: STALE,
}
_NANOSECONDS = 1_000_000_000


def stamp(epoch_ns: int) -> Time:
    """A time of the wall clock, as ROS 2 has it; 0 before 1970 and the latest one after 2038."""
    seconds, nanoseconds = divmod(min(max(epoch_ns, 0), (1 << 31) * _NANOSECONDS - 1), _NANOSECONDS)
    return Time(sec=seconds, nanosec=nanoseconds)


def diagnostics(
    robot: str, slots: Iterable[str], parts: Iterable[PartInfo], stop: StopStatus, epoch_ns: int
) -> DiagnosticArray:
    """What `/diagnostics` says.

    Args:
        robot: the robot's name.
        slots: its slots.
        parts: the parts that are there or were recently, in order of appearance.
        stop: the state of STOP.
        epoch_ns: the present time.
    """
    in_slot = {info.slot: info for info in parts if info.slot is not None}
    wanted = list(slots)
    return DiagnosticArray(
        header=Header(stamp=stamp(epoch_ns), frame_id=""),
        status=[
            _of_robot(robot, wanted, in_slot, stop),
            *(_of_slot(robot, slot, in_slot.get(slot)) for slot in wanted),
        ],
    )


def _of_robot(robot: str, slots: list[str], in_slot: Mapping[str, PartInfo], stop: StopStatus) -> DiagnosticStatus:
    missing = [slot for slot in slots if slot not in in_slot or not in_slot[slot].state.is_registered]
    if stop.stopped:
        level, words = ERROR, f"STOP, said by {stop.by}" + (f": {stop.reason}" if stop.reason else "")
    elif missing:
        level, words = WARN, f"without a part: {', '.join(missing)}"
    else:
        level, words = OK, "every slot has its part"
    return _status(level, robot, words, "", {"slots": str(len(slots)), "filled": str(len(slots) - len(missing))})


def _of_slot(robot: str, slot: str, info: PartInfo | None) -> DiagnosticStatus:
    name = f"{robot}: {slot}"
    if info is None:
        return _status(STALE, name, "empty: no part has been in it", "", {"state": "empty"})
    values = {
        "state": info.state.value,
        "reason": str(info.reason),
        "state_age_s": f"{info.state_age_s:.1f}",
        "part": info.part,
        "part_number": info.part_number,
        "life": str(info.life),
        "beats": str(info.beats),
    }
    if info.beat_age_s is not None:
        values["beat_age_s"] = f"{info.beat_age_s:.2f}"
    level = _LEVELS.get(info.state, WARN)
    # Not the part's UID: it is for teachers, and everybody in the network hears this.
    return _status(level, name, f"{info.state.value}: {info.reason}", info.part_number, values)


def _status(level: int, name: str, message: str, hardware_id: str, values: Mapping[str, str]) -> DiagnosticStatus:
    pairs = [KeyValue(key=_text(key), value=_text(value)) for key, value in values.items()]
    return DiagnosticStatus(
        level=level, name=_text(name), message=_text(message), hardware_id=_text(hardware_id), values=pairs
    )


def _text(text: str) -> str:
    """A text from anywhere as one that can be sent: no NUL, no half characters."""
    return text.replace("\0", " ").encode("utf-8", "replace").decode()
