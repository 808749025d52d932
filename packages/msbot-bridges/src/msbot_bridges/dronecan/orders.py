"""What motor controllers and servos are told, for all of a bus at once. Pure.

Motor controllers take their orders from one array, each by its index; servos from commands, each by its id. New ones
mostly come with the same index or id. Two in the robot that have it in common would both obey what is meant for one of
them: they get no orders but zero, until their slots give them different ones.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Final

from msbot_bridges.dronecan.node_device import NodeDevice

RAW_MOST: Final = 8191
MOST_CONTROLLERS: Final = 20
"""Places of the array."""
MOST_COMMANDS: Final = 15
"""Of one message to servos."""


def motor_powers(devices: Iterable[NodeDevice]) -> list[int]:
    """The array: a number for each index up to the highest that the robot drives; what it does not drive gets 0."""
    powers = dict[int, float]()
    for one in devices:
        if one.esc_index is not None and one.esc_index < MOST_CONTROLLERS:
            powers[one.esc_index] = 0.0 if one.esc_index in powers else one.power
    return [int(RAW_MOST * powers.get(index, 0.0) / 100) for index in range(max(powers, default=-1) + 1)]


def servo_angles(devices: Iterable[NodeDevice]) -> list[list[tuple[int, float]]]:
    """Ids and radians, as many in a message as it has room for; a servo for which nobody has said one gets none."""
    by_id = dict[int, list[NodeDevice]]()
    for one in devices:
        if one.actuator_id is not None:
            by_id.setdefault(one.actuator_id, []).append(one)
    told = [
        (number, alone[0].radians)
        for number, alone in by_id.items()
        if len(alone) == 1 and alone[0].radians is not None
    ]
    return [told[first : first + MOST_COMMANDS] for first in range(0, len(told), MOST_COMMANDS)]


def conflicts(devices: Iterable[NodeDevice]) -> list[tuple[NodeDevice, str]]:
    """Devices in the robot that cannot be told, or not alone, each with a sentence that says why and what to do.

    Args:
        devices: all of the bus; one that is not in the robot obeys as well, and is named by those that are.
    """
    found = list[tuple[NodeDevice, str]]()
    known = sorted(devices, key=lambda one: one.node_id)
    for one in known:
        if not one.is_driven:
            continue
        for what, mine, numbers in (
            ("index", one.esc_index, [(other, other.esc_index) for other in known]),
            ("actuator id", one.actuator_id, [(other, other.actuator_id) for other in known]),
        ):
            if mine is None:
                continue
            setting = one.setting_for(what)
            remedy = f"give one of them another by its setting {setting}" if setting else "give one of them another"
            others = [other for other, number in numbers if number == mine and other is not one]
            if inside := [other.node_id for other in others if other.is_driven]:
                found.append(
                    (
                        one,
                        f"node {one.node_id} and node {inside[0]} both have {what} {mine}, so neither is driven: "
                        f"{remedy}, then restart it",
                    )
                )
            elif others:
                found.append(
                    (one, f"node {others[0].node_id} obeys the orders to node {one.node_id}: both have {what} {mine}")
                )
            if what == "index" and mine >= MOST_CONTROLLERS:
                found.append(
                    (
                        one,
                        f"node {one.node_id} has index {mine}, and RawCommand has places 0 to {MOST_CONTROLLERS - 1}: "
                        "it cannot be driven",
                    )
                )
    return found
