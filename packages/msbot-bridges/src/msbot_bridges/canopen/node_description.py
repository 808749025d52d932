"""What a node says of itself when it is asked: who it is, its profile, its ports and settings."""

from __future__ import annotations

from dataclasses import field
from typing import Final

from canopen import RemoteNode

from msbot_bridges.bridge import DeviceIdentity, DeviceSetting
from msbot_bridges.canopen import objects
from msbot_bridges.canopen.eds_folder import DataSheet, EdsFolder, slug
from msbot_bridges.canopen.emergency_words import emergency_words
from msbot_bridges.canopen.objects import Entry, SettingEntry
from msbot_bridges.canopen.pdo_layout import PdoLayout
from msbot_bridges.canopen.port_mappings import PortMapping, analogue, bits_of, by_unit
from msbot_bridges.canopen.sdo_requests import SdoRefused, SdoRequests
from msbot_xrce.lazy import dataclass

MOST_PORTS: Final = 32
"""More have no room in a description."""
MOST_SETTINGS: Final = 60
PDOS: Final = range(1, 5)
"""Those of the predefined connection set."""
DRIVE, INPUTS_AND_OUTPUTS = 402, 401
_RPM_BY_TIME: Final = {0x47: 1.0, 0x03: 60.0}
_TURN, _INCREMENT, _DEGREE = 0xB4, 0xB5, 0x41


@dataclass(frozen=True, slots=True)
class DriveFacts:
    """What is known of a drive."""

    modes: tuple[int, ...]
    """Of those that a bridge uses: profile velocity, profile position, profile torque."""
    rpm: float
    """Of the shaft, for one unit of velocity."""
    degrees: float | None
    """Of the shaft, for one unit of position; None: the drive does not say."""
    has_velocity: bool
    has_position: bool
    has_torque: bool
    most_torque: float | None
    """In percent of the rated one; None: the drive does not say."""


@dataclass(slots=True)
class NodeDescription:
    """One node."""

    node_id: int
    identity: DeviceIdentity
    heartbeat_ms: int
    """0: it sends none."""
    drive: DriveFacts | None = None
    heard: list[PortMapping] = field(default_factory=list)
    """What it reports."""
    told: list[PortMapping] = field(default_factory=list)
    """What it is told."""
    reports: tuple[PdoLayout, ...] = ()
    """PDOs that it has already: for devices of no known profile."""
    orders: tuple[PdoLayout, ...] = ()
    settings: list[SettingEntry] = field(default_factory=list)
    declared: list[DeviceSetting] = field(default_factory=list)
    """The settings, with the values that it has."""
    emergency: str = ""
    left_out: int = 0
    """Ports for which there is no room."""


def ask_node(node: RemoteNode, folder: EdsFolder) -> NodeDescription | str:
    """Ask a node; a text says why no part can be made of it.

    Raises:
        SdoCommunicationError: it does not answer.
        SdoRefused: it does not tell what every device must.
    """
    ask = SdoRequests(node)
    device_type = ask.number(objects.DEVICE_TYPE)
    vendor = ask.number(objects.VENDOR)
    if device_type is None or vendor is None:
        raise SdoRefused(f"node {node.id} does not say what it is (0x1000, 0x1018)")
    product, revision, serial = (ask.number(one) or 0 for one in (objects.PRODUCT, objects.REVISION, objects.SERIAL))
    sheet = folder.find(vendor, product, node.id)
    profile = device_type & 0xFFFF
    name = ask.text(objects.DEVICE_NAME) or (sheet.product_name if sheet else "") or f"product-0x{product:x}"
    maker = (sheet.vendor_name if sheet else "") or f"vendor-0x{vendor:x}"
    kind = {DRIVE: "drive", INPUTS_AND_OUTPUTS: "inputs and outputs"}.get(profile, "device")
    identity = DeviceIdentity(
        maker,
        name,
        b"%d %d" % (product, serial) if serial else b"%d at node %d" % (product, node.id),
        f"CANopen {kind} {name} of {maker}",
        f"node {node.id}",
        ask.text(objects.HARDWARE_VERSION),
        ask.text(objects.SOFTWARE_VERSION) or f"{revision >> 16}.{revision & 0xFFFF}",
    )
    found = NodeDescription(node.id, identity, ask.number(objects.PRODUCER_HEARTBEAT) or 0)
    if profile == DRIVE:
        found.drive = _drive(ask, sheet)
        if not found.drive.modes:
            modes = "profile velocity, profile torque, and profile position with a scale"
            return f"node {node.id}: its drive has none of the modes {modes}"
        settings = list(objects.DRIVE_SETTINGS)
    elif profile == INPUTS_AND_OUTPUTS:
        _mappings_of_profile(ask, found)
        settings = list(objects.IO_SETTINGS)
    elif sheet is None:
        return (
            f"node {node.id} ({identity.part_number}) has the profile {profile}, which is not known here: put its EDS "
            f"(vendor 0x{vendor:x}, product 0x{product:x}) into a folder and say --option eds=FOLDER"
        )
    else:
        settings = []
        _mappings_of_mapping(ask, found, sheet)
    _cut(found)
    if sheet is not None:
        by_object = {(one.entry.index, one.entry.subindex): one for one in [*settings, *sheet.settings()]}
        settings = list({one.name: one for one in by_object.values()}.values())
    _settings(ask, found, settings)
    found.emergency = _emergency(ask)
    return found


def _drive(ask: SdoRequests, sheet: DataSheet | None) -> DriveFacts:
    supported = ask.number(objects.MODES) or 0
    increments, turns = ask.number(objects.ENCODER_INCREMENTS), ask.number(objects.ENCODER_TURNS)
    per_turn = increments / (turns or 1) if increments else None
    gear = (ask.number(objects.GEAR_MOTOR) or 1) / (ask.number(objects.GEAR_SHAFT) or 1)
    degrees = None if per_turn is None else 360 / (per_turn * gear)
    rpm = _rpm(ask.number(objects.VELOCITY_UNIT), per_turn)
    if sheet is not None:
        if (one := sheet.variable(objects.POSITION.index, 0)) is not None and one.unit in ("°", "deg"):
            degrees = float(one.factor)
        if (one := sheet.variable(objects.VELOCITY.index, 0)) is not None and one.unit in ("rpm", "1/min"):
            rpm = float(one.factor)
    modes = [mode for mode in (objects.PROFILE_VELOCITY, objects.PROFILE_POSITION) if supported >> mode - 1 & 1]
    modes = [mode for mode in modes if mode != objects.PROFILE_POSITION or degrees is not None]
    # Each mode takes a PDO of its own.
    if supported >> objects.PROFILE_TORQUE - 1 & 1 and ask.number(Entry(0x1400 + len(modes), 1, 32)) is not None:
        modes.append(objects.PROFILE_TORQUE)
    most_torque = ask.number(objects.MAX_TORQUE) if objects.PROFILE_TORQUE in modes else None
    return DriveFacts(
        tuple(modes),
        rpm / gear,
        degrees,
        ask.number(objects.VELOCITY) is not None,
        degrees is not None and ask.number(objects.POSITION) is not None,
        objects.PROFILE_TORQUE in modes and ask.number(objects.TORQUE) is not None,
        most_torque * objects.THOUSANDTH if most_torque else None,
    )


def _rpm(unit: int | None, per_turn: float | None) -> float:
    """Of the motor, for one unit of velocity: 0x60A9 has prefix, numerator and denominator of an SI unit."""
    if unit is None:
        return 1.0
    prefix = unit >> 24 & 0xFF
    power = 10.0 ** (prefix - 256 if prefix > 127 else prefix)
    by_angle = {_TURN: 1.0, _DEGREE: 1 / 360, _INCREMENT: 1 / per_turn if per_turn else 0.0}
    return power * by_angle.get(unit >> 16 & 0xFF, 1.0) * _RPM_BY_TIME.get(unit >> 8 & 0xFF, 1.0) or 1.0


def _mappings_of_profile(ask: SdoRequests, found: NodeDescription) -> None:
    for group in range(ask.count(objects.DIGITAL_INPUTS)):
        found.heard += bits_of("in", Entry(objects.DIGITAL_INPUTS, group + 1, 8), 8 * group + 1)
    for number in range(ask.count(objects.ANALOGUE_INPUTS)):
        entry = Entry(objects.ANALOGUE_INPUTS, number + 1, 16, signed=True)
        found.heard.append(analogue(f"level_in_{number + 1}", entry))
    for group in range(ask.count(objects.DIGITAL_OUTPUTS)):
        found.told += bits_of("out", Entry(objects.DIGITAL_OUTPUTS, group + 1, 8), 8 * group + 1)
    for number in range(ask.count(objects.ANALOGUE_OUTPUTS)):
        entry = Entry(objects.ANALOGUE_OUTPUTS, number + 1, 16, signed=True)
        found.told.append(analogue(f"level_out_{number + 1}", entry))


def _mappings_of_mapping(ask: SdoRequests, found: NodeDescription, sheet: DataSheet) -> None:
    """A device of no known profile has a port for each object that its PDOs carry, named as its EDS names it."""
    known = sheet.entries()
    names = set[str]()
    for is_sent, mappings in ((True, found.heard), (False, found.told)):
        layouts = [ask.layout(number, known, is_sent=is_sent) for number in PDOS]
        used = tuple(layout for layout in layouts if layout is not None)
        if is_sent:
            found.reports = used
        else:
            found.orders = used
        for entry in (entry for layout in used for entry in layout.entries):
            variable = sheet.variable(entry.index, entry.subindex)
            if variable is None or (entry.index, entry.subindex) not in known:
                continue
            port = slug(variable.name)
            if port in names:
                port = f"{port}_{entry.index:x}_{entry.subindex}"
            names.add(port)
            is_truth = variable.data_type == 1
            mappings.append(by_unit(port, entry, variable.unit or "", float(variable.factor or 1), is_truth=is_truth))


def _cut(found: NodeDescription) -> None:
    """Leave out ports for which a description has no room, of both directions alike."""
    room_heard = max(MOST_PORTS // 2, MOST_PORTS - len(found.told))
    room_told = MOST_PORTS - min(len(found.heard), room_heard)
    found.left_out = len(found.heard[room_heard:]) + len(found.told[room_told:])
    del found.heard[room_heard:], found.told[room_told:]


def _settings(ask: SdoRequests, found: NodeDescription, candidates: list[SettingEntry]) -> None:
    for one in candidates:
        if len(found.settings) == MOST_SETTINGS:
            return
        value = ask.number(one.entry)
        if value is None:
            continue
        default = value * one.factor if one.default is None else one.default
        least = one.entry.least * one.factor if one.least is None else one.least
        most = one.entry.most * one.factor if one.most is None else one.most
        default = max(least, min(most, default))
        found.settings.append(one)
        found.declared.append(DeviceSetting(one.name, one.kind, one.kind(default), least, most, one.unit))


def _emergency(ask: SdoRequests) -> str:
    """What the node says is wrong with it; its newest error is in 0x1003."""
    register = ask.number(objects.ERROR_REGISTER) or 0
    if not register:
        return ""
    code = ask.number(Entry(0x1003, 1, 32)) or 0x1000
    return emergency_words(code & 0xFFFF, register)
