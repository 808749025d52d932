"""The data types of Cyphal's ports as messages of a robot. Needs no library."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import field
from typing import Any, Final

from msbot.part import Message
from msbot.part.messages.standard import Angle, Battery, Distance, Level, Number, Speed, Switch, Text, Vector
from msbot_bridges.bridge import Fit, fits_of
from msbot_bridges.bridge.quantity import NUMBER, Quantity, quantity
from msbot_xrce.lazy import dataclass

READINESS: Final = "reg.udral.service.common.Readiness.0.1"
FEEDBACK: Final = "reg.udral.service.actuator.common.Feedback.0.1"
STANDBY, ENGAGED = 2, 3
"""Values of `Readiness`."""
Builtin = Mapping[str, Any]
"""The fields of an object of the library, as its `update_from_builtin` takes them."""


@dataclass(frozen=True, slots=True)
class Aspect:
    """One message in a type; a type with several makes a port for each."""

    message: type[Message]
    read: Callable[[Any], Message]
    """The message of an object of the library."""
    write: Callable[[Message], Builtin] | None = None
    """The fields of an object for a message; None: nothing is driven by this type."""
    suffix: str = ""
    """Of the port's name, where a type has several."""
    safe: Message | None = None
    """The value when nobody is in command."""
    near: Callable[[Message, Message], bool] = field(default=lambda report, safe: report == safe)
    """Whether a report is a safe value, as nearly as devices are there."""


def _scalar(field_name: str, unit: str) -> Aspect:
    what = quantity(unit) if unit else NUMBER
    return Aspect(
        what.message,
        lambda told: _made(what, float(getattr(told, field_name))),
        lambda message: {field_name: what.number(message)},
        safe=what.make(0.0),
        near=lambda report, safe: abs(_value(what, report) - _value(what, safe)) <= _NEAR.get(what.message, 0.01),
    )


def _made(what: Quantity, number: float) -> Message:
    if what.message is Distance and not math.isfinite(number):
        return Distance(metres=0.0, in_range=False)
    return what.make(number)


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

    angle, speed = _scalar("radian", "rad"), _scalar("radian_per_second", "rad/s")
    return (
        Aspect(
            Angle,
            lambda told: angle.read(of(told).angular_position),
            lambda message: setpoint(math.radians(message.degrees), math.nan),  # type: ignore[attr-defined]  # an Angle
            "_angle",
            angle.safe,
            angle.near,
        ),
        Aspect(
            Speed,
            lambda told: speed.read(of(told).angular_velocity),
            lambda message: setpoint(math.nan, message.rpm * math.pi / 30),  # type: ignore[attr-defined]  # a Speed
            "_speed",
            speed.safe,
            speed.near,
        ),
    )


def _battery(told: Any) -> Message:  # noqa: ANN401
    power, full = told.value.power, float(told.value.full_energy.joule)
    percent = 100 * float(told.value.energy.joule) / full if full > 0 else math.nan
    return Battery(volts=float(power.voltage.volt), amperes=float(power.current.ampere), percent=percent)


def _power(told: Any) -> Message:  # noqa: ANN401
    return Battery(volts=float(told.value.voltage.volt), amperes=float(told.value.current.ampere), percent=math.nan)


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
            Aspect(Text, lambda told: Text(text=bytes(told.value).decode(errors="replace"))),
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
        f"{udral}.electricity.SourceTs.0.1": (Aspect(Battery, _battery),),
        f"{udral}.electricity.PowerTs.0.1": (Aspect(Battery, _power),),
        "reg.udral.service.actuator.common.sp.Scalar.0.1": (
            Aspect(
                Level,
                lambda told: Level(percent=100 * float(told.value)),
                lambda message: {"value": message.percent / 100},  # type: ignore[attr-defined]  # a Level
                safe=Level(percent=0.0),
            ),
        ),
        FEEDBACK: (Aspect(Level, lambda told: Level(percent=float(told.demand_factor_pct))),),
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
        ((one.message, kind) for kind, one in named),
        ((one.message, kind) for kind, one in named if one.write is not None),
    )


def short_name(type_name: str) -> str:
    """For tables: `length`, `Real32`, `Planar`."""
    words = type_name.split(".")[:-2]
    return words[-2] if words[1] == "si" else words[-1]
