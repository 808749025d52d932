"""Facts about the robot: from its database, from its running master, else from its blueprint."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

from msbot.config import Binding, Blueprint, Library, binding_faults, load_library, open_blueprint
from msbot.doctor.collectors.machine_facts import database_of
from msbot.doctor.facts import PartSeen, RobotFacts
from msbot.doctor.finding import CannotSee, Examined
from msbot.pnp import PartState, forecast
from msbot_agent.agent import AgentStatus
from msbot_agent.link.can import parse_target
from msbot_agent.link.can.adapters import find_interface
from msbot_agent.link.can.protocol import Framing
from msbot_agent.text.sentence import said
from msbot_xrce import compress
from msbot_xrce.errors import ConfigError

if TYPE_CHECKING:
    from msbot.registry import RobotRecord

LATELY_S = 3600.0
MOST_LINES = 5000
"""Lines of the journal that are read."""


def robot(patient: Examined) -> RobotFacts:
    """The robot."""
    file = patient.database_file
    if (patient.database is None or (file is not None and not file.exists())) and patient.blueprint is not None:
        return _of_blueprint(patient)
    from msbot.registry import open_registry
    from msbot.registry.edits.wires import read_library
    from msbot.registry.running.robot_memory import read_memory

    with open_registry(database_of(patient), read_only=True) as registry:
        record = _meant(registry.robots.all(), patient.robot)
        memory = registry.storage.read(lambda connection: read_memory(connection, record.id))
        library = registry.storage.read(lambda connection: read_library(connection, record.id))
        lines = registry.robots.journal(MOST_LINES, robot=record)
        parts = tuple(
            PartSeen(part.name, part.slot or "", part.state, part.reason, part.uid.hex())
            for part in registry.robots.parts(record)
        )
        is_run = registry.runs.is_run(record)
    since_ns = time.time_ns() - int(LATELY_S * 1e9)
    recent = [line.event for line in lines if line.at_ns >= since_ns]
    refused: dict[str, tuple[str, ...]] = {}
    for event in recent:
        if event.to_state is PartState.REFUSED:
            refused[event.part] = (*refused.get(event.part, ()), event.reason)
    blueprint = memory.blueprint
    known = [one for one in patient.masters if _is_of(one, record.name, record.serial_number)]
    stop = memory.stop
    return _facts(
        patient,
        blueprint,
        library,
        is_run=is_run,
        masters=known,
        stopped_by=stop.by if stop is not None and stop.holds else "",
        parts=parts,
        late=Counter(event.part for event in recent if event.to_state is PartState.LATE),
        refused=refused,
        blocked=frozenset(key for kind, key in memory.blocks if kind == "uid"),
        keys=frozenset(memory.keys),
    )


def _meant(robots: Sequence[RobotRecord], name: str | None) -> RobotRecord:
    if not robots:
        raise CannotSee(
            said(
                "there is no robot in the database yet: `msbot apply robot.toml` or `msbot master robot.toml` puts "
                "one there"
            )
        )
    found = [one for one in robots if name in (None, one.name, one.serial_number)]
    if len(found) != 1:
        names = ", ".join(one.name for one in robots)
        raise CannotSee(said("the database has the robots {names}: say which one with --robot", names=names))
    return found[0]


def _of_blueprint(patient: Examined) -> RobotFacts:
    assert patient.blueprint is not None
    blueprint, library = open_blueprint(patient.blueprint)
    return _facts(
        patient,
        blueprint,
        library,
        is_run=False,
        masters=[],
        stopped_by="",
        parts=(),
        late={},
        refused={},
        blocked=frozenset(),
        keys=frozenset(),
    )


def _is_of(master: AgentStatus, name: str, serial_number: str) -> bool:
    return master.details.get("robot") == name and master.details.get("serial_number") == serial_number


def _facts(
    patient: Examined,
    blueprint: Blueprint,
    library: Library,
    *,
    is_run: bool,
    masters: list[AgentStatus],
    stopped_by: str,
    parts: tuple[PartSeen, ...],
    late: Mapping[str, int],
    refused: Mapping[str, tuple[str, ...]],
    blocked: frozenset[str],
    keys: frozenset[str],
) -> RobotFacts:
    bitrate, data_bitrate = _bitrates(patient)
    load = 0.0
    if bitrate:
        is_fd = data_bitrate is not None
        # A database has no message types: those of MsBOT say how large samples are, others are taken for small.
        messages = library.messages or load_library().messages
        sizes = {name: size for name, one in messages.items() if (size := one.size_bytes) is not None}
        found = forecast(blueprint, library, Framing(is_fd, is_fd, compress), sizes=sizes)
        load = found.load(bitrate, data_bitrate)
    lost: Counter[str] = Counter()
    for master in masters:
        for link in master.links:
            lost.update(link.dropped)
    return RobotFacts(
        name=blueprint.robot.name,
        is_run=is_run,
        masters=len(masters),
        up_s=max((master.up_s for master in masters), default=0.0),
        stopped_by=stopped_by,
        blueprint=blueprint,
        library=library,
        parts=parts,
        late=late,
        refused=refused,
        blocked=blocked,
        keys=keys,
        wire_faults=wire_faults(blueprint, library),
        bus_bitrate=bitrate,
        bus_load=load,
        not_stored=next((trouble for master in masters if (trouble := master.details.get("trouble"))), ""),
        type_differences=tuple(
            line for master in masters for line in master.details.get("type_differences", "").splitlines()
        ),
        lost_packets=lost,
    )


def wire_faults(blueprint: Blueprint, library: Library) -> dict[str, str]:
    """Topics whose wires do not fit the part types, and why."""
    found: dict[str, str] = {}
    for binding in blueprint.bindings:
        faults = _faults(binding, blueprint, library)
        if faults:
            found[binding.topic] = faults[0]
    return found


def _faults(binding: Binding, blueprint: Blueprint, library: Library) -> list[str]:
    return binding_faults([binding], blueprint.slots, library)


def _bitrates(patient: Examined) -> tuple[int, int | None]:
    """Bit rate and, with CAN FD, data bit rate of the robot's bus; 0: it has none, or it is not known."""
    for rest in patient.of_kind("can", "canfd"):
        try:
            target = parse_target(rest)
        except ConfigError:
            continue  # `msbot doctor` itself refuses such an address
        bitrate, data_bitrate = target.bitrate, target.data_bitrate
        if target.interface == "socketcan":
            try:
                found = find_interface(target.channel)
            except OSError:
                found = None  # no Linux; `can` tells
            bitrate = bitrate or (found.bitrate if found else None)
            data_bitrate = data_bitrate or (found.data_bitrate if found else None)
        if bitrate:
            return bitrate, data_bitrate
    return 0, None
