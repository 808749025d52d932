"""The data types of UDRAL's services for batteries and groups of actuators as messages of a robot. Needs no library.

A group of motor controllers shares one subject, on which a vector has a set point for each: by its place in it a
controller knows its own. A standalone one has a scalar, a group of one.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, Final

from msbot.part import Message
from msbot.part.messages.standard import Battery, Level, Number, Temperature, Text
from msbot_bridges.cyphal.aspect import FEEDBACK, Aspect, Builtin

_SET_POINTS: Final = "reg.udral.service.actuator.common.sp"
VECTOR_SIZES: Final = (2, 3, 4, 6, 8, 31)
"""So many places the vectors of the standard have."""
VECTORS: Final[Mapping[str, int]] = {f"{_SET_POINTS}.Vector{size}.0.1": size for size in VECTOR_SIZES}
"""The types of a group's set points, each with its places."""
KELVIN_0: Final = -273.15
_COULOMB_PER_AH: Final = 3600.0
_BATTERY_ERRORS: Final[Mapping[int, str]] = {
    0: "",
    10: "it should not be used any more",
    11: "it needs service",
    20: "its management system has an error",
    30: "its configuration is missing or wrong",
    50: "it was discharged too far",
    51: "it is charged or discharged too quickly",
    60: "the voltage of a cell is too high",
    61: "the voltage of a cell is too low",
    62: "a cell is missing",
    100: "it is too hot",
    101: "it is too cold",
}
_FAULTS: Final = (
    *("overload", "voltage", "motor_temperature", "controller_temperature", "velocity", "mechanical"),
    *("vibration", "configuration", "control_mode", "other"),
)


def vector_type(places: int) -> str:
    """The smallest vector with so many places."""
    return next(name for name, size in VECTORS.items() if size >= places)


def _set_point(message: Message) -> Builtin:
    return {"value": message.percent / 100}  # type: ignore[attr-defined]  # a Level


def _source(told: Any) -> Message:  # noqa: ANN401 - the library makes its classes when it runs
    power, full = told.value.power, float(told.value.full_energy.joule)
    percent = 100 * float(told.value.energy.joule) / full if full > 0 else math.nan
    return Battery(volts=float(power.voltage.volt), amperes=float(power.current.ampere), percent=percent)


def _power(told: Any) -> Message:  # noqa: ANN401
    return Battery(volts=float(told.value.voltage.volt), amperes=float(told.value.current.ampere), percent=math.nan)


def _celsius(told: Any) -> Message:  # noqa: ANN401
    return Temperature(celsius=float(told.kelvin) + KELVIN_0)


def _weakest_cell(told: Any) -> Message:  # noqa: ANN401
    return Number(value=min(map(float, told.cell_voltages), default=math.nan))


def _battery_error(told: Any) -> Message:  # noqa: ANN401
    code = int(told.error.value)
    return Text(text=_BATTERY_ERRORS.get(code, f"error {code}"))


def _actuator_faults(told: Any) -> Message:  # noqa: ANN401
    flags = told.fault_flags
    return Text(text=", ".join(name.replace("_", " ") for name in _FAULTS if getattr(flags, name)))


SERVICE_TYPES: Final[Mapping[str, tuple[Aspect, ...]]] = {
    "reg.udral.physics.electricity.SourceTs.0.1": (Aspect(Battery, _source),),
    "reg.udral.physics.electricity.PowerTs.0.1": (Aspect(Battery, _power),),
    "reg.udral.service.battery.Status.0.2": (
        Aspect(Temperature, lambda told: _celsius(told.temperature_min_max[1]), suffix="_temperature"),
        Aspect(Number, _weakest_cell, suffix="_weakest_cell"),
        Aspect(
            Number,
            lambda told: Number(value=float(told.available_charge.coulomb) / _COULOMB_PER_AH),
            suffix="_ampere_hours",
        ),
        Aspect(Text, _battery_error, suffix="_error"),
    ),
    "reg.udral.service.battery.Parameters.0.3": (
        Aspect(Level, lambda told: Level(percent=float(told.state_of_health_pct)), suffix="_health"),
        Aspect(Number, lambda told: Number(value=float(told.cycle_count)), suffix="_cycles"),
    ),
    f"{_SET_POINTS}.Scalar.0.1": (
        Aspect(Level, lambda told: Level(percent=100 * float(told.value)), _set_point, safe=Level(percent=0.0)),
    ),
    **{name: (Aspect(Level, None, _set_point, safe=Level(percent=0.0)),) for name in VECTORS},
    FEEDBACK: (Aspect(Level, lambda told: Level(percent=float(told.demand_factor_pct))),),
    "reg.udral.service.actuator.common.Status.0.1": (
        Aspect(Temperature, lambda told: _celsius(told.motor_temperature), suffix="_motor"),
        Aspect(Temperature, lambda told: _celsius(told.controller_temperature), suffix="_controller"),
        Aspect(Text, _actuator_faults, suffix="_faults"),
    ),
}
"""By the name that a node gives in `uavcan.pub.NAME.type`."""
