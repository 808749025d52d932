"""One node as a device: what it broadcasts says what it is.

A node does not declare its messages. It is listened to for a while after it has said who it is; the messages that it
sends decide its ports. Whether it has stopped, only its own reports say: a motor that stands still, a servo at its
neutral position, or what its slot has instead.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

from msbot.part import Message
from msbot.part.messages.standard import Angle, Battery, Distance, Level, Place, Speed, Temperature
from msbot_agent.text.sentence import said
from msbot_bridges.bridge import (
    DeviceIdentity,
    DeviceOutput,
    DeviceSetting,
    Fit,
    ForeignDevice,
    Input,
    Report,
    fits_of,
)
from msbot_bridges.canbus.image_folder import ImageFolder
from msbot_bridges.canbus.updatable_node import UpdatableNode

NEAR_DEGREES = 3.0
"""A servo has its safe value when it reports an angle no farther from it."""
STANDS_RPM = 1.0
NEAR_PERCENT = 3.0
"""The same of a motor controller whose slot has it turn at STOP: it reports its power in whole percent."""

ESC, SERVO, RANGE, BATTERY, PLACE = (
    "uavcan.equipment.esc.Status",
    "uavcan.equipment.actuator.Status",
    "uavcan.equipment.range_sensor.Measurement",
    "uavcan.equipment.power.BatteryInfo",
    "uavcan.equipment.gnss.Fix2",
)
_OUTPUTS = {
    ESC: (DeviceOutput("turns", Speed), DeviceOutput("supply", Battery), DeviceOutput("temperature", Temperature)),
    SERVO: (DeviceOutput("position", Angle),),
    RANGE: (DeviceOutput("distance", Distance),),
    BATTERY: (DeviceOutput("battery", Battery),),
    PLACE: (DeviceOutput("place", Place),),
}
_INPUTS = {
    ESC: Input("power", Level, safe=Level(percent=0)),
    SERVO: Input("angle", Angle, safe=Angle(degrees=0)),
}
KINDS = tuple(_OUTPUTS)
"""The messages that decide what a node is."""


_KIND_WORDS = {
    ESC: said("motor controllers"),
    SERVO: said("servos"),
    RANGE: said("range finders"),
    BATTERY: said("batteries"),
    PLACE: said("GNSS receivers"),
}


def node_fits() -> tuple[Fit, ...]:
    """Which messages nodes send, and are driven by."""
    return fits_of(
        ((one.message, _KIND_WORDS[kind]) for kind, outputs in _OUTPUTS.items() for one in outputs),
        ((one.message, _KIND_WORDS[kind]) for kind, one in _INPUTS.items()),
    )


class NodeDevice(UpdatableNode):
    """A node.

    Args:
        identity: from its GetNodeInfo.
        node_id: where it is.
        seen: the messages that it sends, by type, the newest of each.
        settings: its parameters.
        order: called, in the event loop, whenever what it is to do has changed; True: it is STOP.
        write: writes a parameter.
        restart: restarts it.
        update: gives it new software, by the name of its image.
        images: from which it can get new software; None: from none.
        remark: how it got the software that it has.
        news: called when it has reported something.
    """

    def __init__(
        self,
        identity: DeviceIdentity,
        node_id: int,
        seen: dict[str, Any],
        settings: tuple[DeviceSetting, ...],
        *,
        order: Callable[[bool], None],
        write: Callable[[str, object], None],
        restart: Callable[[], None],
        update: Callable[[str], None],
        images: ImageFolder | None = None,
        remark: str = "",
        news: Callable[[ForeignDevice], None],
    ) -> None:
        super().__init__(identity, node_id, images, remark)
        self.kinds = tuple(kind for kind in KINDS if kind in seen)
        self.outputs = tuple(output for kind in self.kinds for output in _OUTPUTS[kind])
        self.inputs = tuple(_INPUTS[kind] for kind in self.kinds if kind in _INPUTS)
        self.settings = settings
        self.esc_index = seen[ESC].esc_index if ESC in seen else None
        self.actuator_id = seen[SERVO].actuator_id if SERVO in seen else None
        self.is_driven = False
        """It is in the robot, and gets orders."""
        self.is_stopping = False
        self.power = 0.0
        """-100 to 100."""
        self.radians: float | None = None
        """None: nobody has said where a servo is to be, so it stays where it is."""
        self._stated = dict[str, Message]()
        """Safe values that the robot has said, with this STOP or when it left its ports."""
        self.is_critical = self.is_updating = False
        """As its NodeStatus says."""
        self._order, self._write, self._news = order, write, news
        self._restart, self._update = restart, update
        self._report: Report | None = None
        self._unconfirmed = set[str]()
        self.stop_number = 0
        """Which STOP holds, or held last."""

    def begin(self, report: Report) -> None:
        """See `ForeignDevice`."""
        self._report, self.is_driven = report, True
        self._order(False)

    def end(self) -> None:
        """See `ForeignDevice`."""
        self._report, self.is_driven = None, False
        self.is_stopping = False
        self._stated.clear()
        self._order(False)
        self.take_update()

    def act(self, port: str, message: Message) -> None:
        """See `ForeignDevice`."""
        self._stated.pop(port, None)
        self._take(message)
        self._order(False)

    def _take(self, message: Message) -> None:
        if isinstance(message, Level):
            self.power = max(-100.0, min(100.0, message.percent))
        elif isinstance(message, Angle):
            self.radians = math.radians(message.degrees)

    def changed(self) -> None:
        """See `UpdatableNode`."""
        self._news(self)

    def tell_restart(self) -> None:
        """See `UpdatableNode`."""
        self._restart()

    def tell_update(self, image: str) -> None:
        """See `UpdatableNode`."""
        self._update(image)

    def set(self, name: str, value: object) -> None:
        """See `ForeignDevice`."""
        self._write(name, value)

    def safe_is(self, port: str, message: Message) -> None:
        """See `ForeignDevice`: `stop` orders it, and waits for its report."""
        self._stated[port] = message

    def stop(self) -> None:
        """See `ForeignDevice`."""
        if not self.is_stopping:
            self._unconfirmed = {kind for kind in self.kinds if kind in _INPUTS}
            self.stop_number += 1
        self.is_stopping = self.is_driven = True
        for kind in self.kinds:
            if (safe := self._safe(kind)) is not None:
                self._take(safe)
        self._order(True)

    def rests_at(self, port: str, message: Message) -> None:
        """See `ForeignDevice`."""
        self.act(port, message)
        self._stated[port] = message

    def rest(self) -> None:
        """See `ForeignDevice`; each port has got its safe value."""

    def leave(self) -> None:
        """See `ForeignDevice`: as at STOP, it reports that it is safe."""
        self.stop()

    def go(self) -> None:
        """See `ForeignDevice`."""
        self.is_stopping = False
        self._stated.clear()
        self._order(False)

    def _safe(self, kind: str) -> Message | None:
        """What STOP brings a kind of device to; None: it is not driven."""
        port = _INPUTS.get(kind)
        return None if port is None else self._stated.get(port.name, port.safe)

    @property
    def not_stopped(self) -> str:
        """See `ForeignDevice`."""
        if not self.is_stopping or not self._unconfirmed:
            return ""
        kind = min(self._unconfirmed)
        match self._safe(kind):
            case Level(percent=percent) if percent:
                what = f"a power of {percent:g} %"
            case Angle(degrees=degrees) if degrees:
                what = f"an angle of {degrees:g} degrees"
            case Angle():
                what = "its neutral position"
            case _:
                what = "that it stands still"
        return f"node {self.node_id} has not reported {what}"

    @property
    def fault(self) -> str:
        """See `ForeignDevice`."""
        if self.update_words:
            return self.update_words
        if self.is_updating:
            return f"node {self.node_id} takes new software"
        return f"node {self.node_id} says that its health is CRITICAL" if self.is_critical else ""

    def numbered(self, kind: str, message: Any) -> None:  # noqa: ANN401 - the library makes its classes when it runs
        """Its report says by which number it takes orders now; called in the thread of its world."""
        if kind == ESC:
            self.esc_index = message.esc_index
        elif kind == SERVO:
            self.actuator_id = message.actuator_id

    def setting_for(self, what: str) -> str:
        """The setting with that number, as far as its name tells; empty: none.

        Args:
            what: `index` of a motor controller, or `actuator id` of a servo.
        """
        word = what.replace(" ", "_")
        return next((one.name for one in self.settings if one.kind is int and word in one.name.lower()), "")

    def health(self, is_critical: bool, is_updating: bool) -> None:
        """Its NodeStatus says something else than the one before."""
        self.is_critical, self.is_updating = is_critical, is_updating
        self._news(self)

    def heard(self, kind: str, message: Any, *, is_old: bool = False) -> None:  # noqa: ANN401 - as above
        """It has broadcast one of its messages; an old one may be of the time before STOP."""
        report = self._report or (lambda _port, _message: None)
        if kind == ESC:
            report("turns", Speed(rpm=message.rpm))
            report("supply", Battery(volts=message.voltage, amperes=message.current, percent=math.nan))
            report("temperature", Temperature(celsius=message.temperature - 273.15))
            self._confirm(kind, not is_old and self._is_safe_power(message))
        elif kind == SERVO:
            degrees = math.degrees(message.position)
            report("position", Angle(degrees=degrees))
            safe = self._safe(kind)
            assert isinstance(safe, Angle)
            self._confirm(kind, not is_old and abs(degrees - safe.degrees) <= NEAR_DEGREES)
        elif kind == RANGE:
            in_range = message.reading_type == message.READING_TYPE_VALID_RANGE
            report("distance", Distance(metres=message.range if in_range else 0.0, in_range=in_range))
        elif kind == BATTERY:
            percent = float(message.state_of_charge_pct)
            report("battery", Battery(volts=message.voltage, amperes=message.current, percent=percent))
        elif kind == PLACE and message.status >= message.STATUS_2D_FIX:  # without a fix it knows no place
            height = message.height_msl_mm / 1000 if message.status == message.STATUS_3D_FIX else math.nan
            report(
                "place",
                Place(
                    latitude=message.latitude_deg_1e8 / 1e8,
                    longitude=message.longitude_deg_1e8 / 1e8,
                    altitude=height,
                    satellites=message.sats_used,
                ),
            )

    def _is_safe_power(self, message: Any) -> bool:  # noqa: ANN401
        safe = self._safe(ESC)
        assert isinstance(safe, Level)
        if not safe.percent:
            return bool(abs(message.rpm) <= STANDS_RPM)
        return bool(abs(message.power_rating_pct - abs(safe.percent)) <= NEAR_PERCENT)

    def _confirm(self, kind: str, is_safe: bool) -> None:
        if self.is_stopping and is_safe and kind in self._unconfirmed:
            self._unconfirmed.discard(kind)
            self._news(self)
