"""The data types of Cyphal's ports as messages of a robot. Needs no library."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any, Final

from msbot.part import Message
from msbot.part.messages.standard import Angle, Distance, Number, Speed, Switch, Text, Vector
from msbot_bridges.bridge import Fit, fits_of
from msbot_bridges.bridge.quantity import NUMBER, Quantity, quantity, text_message
from msbot_bridges.cyphal.aspect import Aspect, Builtin
from msbot_bridges.cyphal.service_types import SERVICE_TYPES
from msbot_bridges.cyphal.service_types import VECTORS as GROUPS


def _scalar(field_name: str, unit: str) -> Aspect:
    what = quantity(unit) if unit else NUMBER
    return Aspect(
        what.message,
        lambda told: _made(what, float(getattr(told, field_name))),
        lambda message: {field_name: what.number(message)},
        safe=what.make(0.0),
        near=lambda report, safe: abs(_value(what, report) - _value(what, safe)) <= _NEAR.get(what.message, 0.01),
    )


def _made(what: Quantity, number: float) -> Message | None:
    if what.message is Distance and not math.isfinite(number):
        return Distance(metres=0.0, in_range=False)
    return what.made(number)


def _value(what: Quantity, message: Message) -> float:
    return float(getattr(message, what.name))


_NEAR: Final[Mapping[type[Message], float]] = {Angle: 3.0, Speed: 1.0}
"""A report that differs no more from the safe value is that: degrees, turns a minute."""

SI: Final[Mapping[str, tuple[str, str]]] = {
    "acceleration": ("meter_per_second_per_second", ""),
    "angle": ("radian", "rad"),
    "angular_acceleration": ("radian_per_second_per_second", ""),
    "angular_velocity": ("radian_per_second", "rad/s"),
    "duration": ("second", ""),
    "electric_charge": ("coulomb", ""),
    "electric_current": ("ampere", ""),
    "energy": ("joule", ""),
    "force": ("newton", ""),
    "frequency": ("hertz", ""),
    "length": ("meter", "m"),
    "luminance": ("candela_per_square_meter", ""),
    "mass": ("kilogram", "kg"),
    "power": ("watt", ""),
    "pressure": ("pascal", "Pa"),
    "temperature": ("kelvin", "K"),
    "torque": ("newton_meter", ""),
    "velocity": ("meter_per_second", ""),
    "voltage": ("volt", ""),
    "volume": ("cubic_meter", ""),
    "volumetric_flow_rate": ("cubic_meter_per_second", ""),
}
"""The field of each quantity of `uavcan.si`, and its unit where a standard message has one."""
VECTORS: Final[Mapping[str, str]] = {
    "acceleration": "meter_per_second_per_second",
    "angular_velocity": "radian_per_second",
    "magnetic_flux_density": "tesla",
    "velocity": "meter_per_second",
}


def _vector(field_name: str) -> Aspect:
    def read(told: Any) -> Message:  # noqa: ANN401 - the library makes its classes when it runs
        x, y, z = map(float, getattr(told, field_name))
        return Vector(x=x, y=y, z=z)

    return Aspect(Vector, read)


def _planar(of: Callable[[Any], Any], wrap: Callable[[Builtin], Builtin]) -> tuple[Aspect, Aspect]:
    """The first field that is finite is what an actuator is to reach; the others are left to it."""

    def setpoint(angle: float, speed: float) -> Builtin:
        return wrap(
            {
                "angular_position": {"radian": angle},
                "angular_velocity": {"radian_per_second": speed},
                "angular_acceleration": {"radian_per_second_per_second": math.nan},
            }
        )

    (angle, read_angle), (speed, read_speed) = (
        (one, one.read)
        for one in (_scalar("radian", "rad"), _scalar("radian_per_second", "rad/s"))
        if one.read is not None
    )
    return (
        Aspect(
            Angle,
            lambda told: read_angle(of(told).angular_position),
            lambda message: setpoint(math.radians(message.degrees), math.nan),  # type: ignore[attr-defined]  # an Angle
            "_angle",
            angle.safe,
            angle.near,
        ),
        Aspect(
            Speed,
            lambda told: read_speed(of(told).angular_velocity),
            lambda message: setpoint(math.nan, message.rpm * math.pi / 30),  # type: ignore[attr-defined]  # a Speed
            "_speed",
            speed.safe,
            speed.near,
        ),
    )


def _types() -> dict[str, tuple[Aspect, ...]]:
    udral = "reg.udral.physics"
    found: dict[str, tuple[Aspect, ...]] = {
        "uavcan.primitive.scalar.Bit.1.0": (
            Aspect(
                Switch,
                lambda told: Switch(on=bool(told.value)),
                lambda message: {"value": message.on},  # type: ignore[attr-defined]  # a Switch
                safe=Switch(on=False),
            ),
        ),
        "uavcan.primitive.String.1.0": (
            Aspect(Text, lambda told: text_message(bytes(told.value).decode(errors="replace"))),
        ),
        f"{udral}.kinematics.rotation.Planar.0.1": _planar(lambda told: told, lambda fields: fields),
        f"{udral}.dynamics.rotation.Planar.0.1": _planar(
            lambda told: told.kinematics,
            lambda fields: {"kinematics": fields, "torque": {"newton_meter": math.nan}},
        ),
        f"{udral}.kinematics.rotation.PlanarTs.0.1": _only_read(
            _planar(lambda told: told.value, lambda fields: fields)
        ),
        f"{udral}.dynamics.rotation.PlanarTs.0.1": _only_read(
            _planar(lambda told: told.value.kinematics, lambda fields: fields)
        ),
        **SERVICE_TYPES,
    }
    for kind in ("Real16", "Real32", "Real64"):
        found[f"uavcan.primitive.scalar.{kind}.1.0"] = (_scalar("value", ""),)
    for bits in (8, 16, 32, 64):
        found[f"uavcan.primitive.scalar.Integer{bits}.1.0"] = (_whole(-(1 << bits - 1), (1 << bits - 1) - 1),)
        found[f"uavcan.primitive.scalar.Natural{bits}.1.0"] = (_whole(0, (1 << bits) - 1),)
    for kind in ("unit", "sample"):
        for name, (field_name, unit) in SI.items():
            found[f"uavcan.si.{kind}.{name}.Scalar.1.0"] = (_scalar(field_name, unit),)
        for name, field_name in VECTORS.items():
            found[f"uavcan.si.{kind}.{name}.Vector3.1.0"] = (_vector(field_name),)
        found[f"uavcan.si.{kind}.length.WideScalar.1.0"] = (_scalar("meter", "m"),)
    return found


def _only_read(aspects: Sequence[Aspect]) -> tuple[Aspect, ...]:
    return tuple(Aspect(one.message, one.read, None, one.suffix, None, one.near) for one in aspects)


def _whole(least: int, most: int) -> Aspect:
    base = _scalar("value", "")
    return Aspect(
        Number,
        base.read,
        lambda message: {"value": min(max(round(message.value), least), most)},  # type: ignore[attr-defined]
        safe=base.safe,
        near=base.near,
    )


TYPES: Final = _types()
"""By the name that a node gives in `uavcan.pub.NAME.type`."""


def port_fits() -> tuple[Fit, ...]:
    """Which messages nodes send, and are driven by."""
    named = [(short_name(name), one) for name, aspects in TYPES.items() for one in aspects]
    return fits_of(
        ((one.message, kind) for kind, one in named if one.read is not None),
        ((one.message, kind) for kind, one in named if one.write is not None),
    )


def short_name(type_name: str) -> str:
    """For tables: `length`, `Real32`, `Planar`."""
    words = type_name.split(".")[:-2]
    if type_name in GROUPS:
        return "set points of a group"
    if words[-2] == "battery":
        return f"battery {words[-1]}"
    return words[-2] if words[1] == "si" else words[-1]
