"""One node as a device: what it broadcasts says what it is.

A node does not declare its messages. It is listened to for a while after it has said who it is; the messages that it
sends decide its ports. Whether it has stopped, only its own reports say: a motor that stands still, a servo that is at
its neutral position.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

from msbot.part import Message
from msbot.part.messages.standard import Angle, Battery, Distance, Level, Place, Speed, Temperature, Text, Trigger
from msbot_agent.text.sentence import said
from msbot_bridges.bridge import (
    DeviceIdentity,
    DeviceOutput,
    DeviceService,
    DeviceSetting,
    Fit,
    ForeignDevice,
    Input,
    Report,
    fits_of,
)
from msbot_bridges.canbus.software_update import ImageFolder
from msbot_bridges.canbus.software_wish import UPDATE, SoftwareWish

NEUTRAL_DEGREES = 3.0
"""A servo is at its neutral position when it reports no more than this."""
STANDS_RPM = 1.0

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
RESTART = "restart"
"""A service."""


def node_fits() -> tuple[Fit, ...]:
    """Which messages nodes send, and are driven by."""
    return fits_of(
        ((one.message, _KIND_WORDS[kind]) for kind, outputs in _OUTPUTS.items() for one in outputs),
        ((one.message, _KIND_WORDS[kind]) for kind, one in _INPUTS.items()),
    )


class NodeDevice(ForeignDevice):
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
        write: Callable[[int, str, object], None],
        restart: Callable[[], None],
        update: Callable[[str], None],
        images: ImageFolder | None = None,
        remark: str = "",
        news: Callable[[ForeignDevice], None],
    ) -> None:
        self.identity = identity
        self.node_id = node_id
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
        self.radians = 0.0
        self.is_critical = self.is_updating = False
        """As its NodeStatus says."""
        self.services = (DeviceService(RESTART, Trigger, Text),)
        self._wish = None if images is None else SoftwareWish(f"node {node_id}", images, lambda: news(self))
        if self._wish is not None:
            self.services += (UPDATE,)
        self._order, self._write, self._news = order, write, news
        self._restart, self._update, self._remark = restart, update, remark
        self._report: Report | None = None
        self._unconfirmed = set[str]()

    def begin(self, report: Report) -> None:
        """See `ForeignDevice`."""
        self._report, self.is_driven = report, True
        self._order(False)

    def end(self) -> None:
        """See `ForeignDevice`."""
        self._report, self.is_driven = None, False
        self._order(False)
        if self._wish is not None and (image := self._wish.take()):
            self._update(image)

    def act(self, port: str, message: Message) -> None:  # noqa: ARG002 - the class says which
        """See `ForeignDevice`."""
        if isinstance(message, Level):
            self.power = max(-100.0, min(100.0, message.percent))
        elif isinstance(message, Angle):
            self.radians = math.radians(message.degrees)
        self._order(False)

    def serve(self, name: str, request: Message) -> Message:
        """See `ForeignDevice`."""
        if name == RESTART:
            self._restart()
            return Text(text=f"node {self.node_id} was told to restart")
        assert self._wish is not None, name
        return self._wish.serve(request)

    def set(self, name: str, value: object) -> None:
        """See `ForeignDevice`."""
        self._write(self.node_id, name, value)

    def stop(self) -> None:
        """See `ForeignDevice`."""
        if not self.is_stopping:
            self._unconfirmed = {kind for kind in self.kinds if kind in _INPUTS}
        self.is_stopping = self.is_driven = True
        self.power = self.radians = 0.0
        self._order(True)

    def go(self) -> None:
        """See `ForeignDevice`."""
        self.is_stopping = False
        self._order(False)

    @property
    def not_stopped(self) -> str:
        """See `ForeignDevice`."""
        if not self.is_stopping or not self._unconfirmed:
            return ""
        what = "that it stands still" if ESC in self._unconfirmed else "its neutral position"
        return f"node {self.node_id} has not reported {what}"

    @property
    def fault(self) -> str:
        """See `ForeignDevice`."""
        if self._wish is not None and self._wish.state:
            return self._wish.state
        if self.is_updating:
            return f"node {self.node_id} takes new software"
        return f"node {self.node_id} says that its health is CRITICAL" if self.is_critical else ""

    @property
    def remark(self) -> str:
        """See `ForeignDevice`."""
        return self._remark

    def not_updated(self, why: str) -> None:
        """It has not taken new software, and goes on as it was."""
        self._remark = why
        if self._wish is not None:
            self._wish.end()

    def health(self, is_critical: bool, is_updating: bool) -> None:
        """Its NodeStatus says something else than the one before."""
        self.is_critical, self.is_updating = is_critical, is_updating
        self._news(self)

    def heard(self, kind: str, message: Any) -> None:  # noqa: ANN401 - the library makes its classes when it runs
        """It has broadcast one of its messages."""
        report = self._report or (lambda _port, _message: None)
        if kind == ESC:
            report("turns", Speed(rpm=message.rpm))
            report("supply", Battery(volts=message.voltage, amperes=message.current, percent=math.nan))
            report("temperature", Temperature(celsius=message.temperature - 273.15))
            self._confirm(kind, abs(message.rpm) <= STANDS_RPM)
        elif kind == SERVO:
            degrees = math.degrees(message.position)
            report("position", Angle(degrees=degrees))
            self._confirm(kind, abs(degrees) <= NEUTRAL_DEGREES)
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

    def _confirm(self, kind: str, stands: bool) -> None:
        if self.is_stopping and stands and kind in self._unconfirmed:
            self._unconfirmed.discard(kind)
            self._news(self)
