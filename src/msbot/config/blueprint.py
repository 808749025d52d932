"""The blueprint of a robot: `robot.toml` as values (thesis 3.12.2).

A blueprint says who the robot is (profile), which roles it has (slots), who talks to whom (bindings) and how quickly
a silent part is noticed (timing). It names no hardware: which part sits in a slot is the registry's business.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

from msbot.config.check import check_bindings, check_free_topics, check_slots, check_timing
from msbot.config.document import Document, parse_document, read_document
from msbot.config.library import Library
from msbot.config.plan import AUTHENTICATIONS, PRESETS, Binding, Endpoint, Options, RobotProfile, Slot, Timing
from msbot.config.problems import Problems
from msbot.config.reader import Table


@dataclass(frozen=True, slots=True)
class Blueprint:
    """Everything `robot.toml` says, checked against the library."""

    robot: RobotProfile
    slots: tuple[Slot, ...]
    bindings: tuple[Binding, ...] = ()
    timing: Timing = field(default_factory=lambda: PRESETS["thesis"])
    options: Options = field(default_factory=Options)
    source: Path | None = None
    """The file it was read from."""

    def slot(self, name: str) -> Slot | None:
        """The slot of that name."""
        return next((slot for slot in self.slots if slot.name == name), None)

    def topics(self) -> Mapping[str, str]:
        """Every bound topic and its message type, in the order of the file."""
        return {binding.topic: binding.type_name for binding in self.bindings}


def load_blueprint(path: Path, library: Library) -> Blueprint:
    """Read a blueprint and check it against the part library.

    Raises:
        ConfigError: the file cannot be read, or is wrong; the text names every problem with line and remedy.
    """
    problems = Problems()
    document = read_document(path, problems, if_missing=f"`msbot init {path}` writes a sample robot there")
    problems.raise_if_any()
    assert document is not None
    blueprint = _read(document, problems, library, path)
    problems.raise_if_any()
    return blueprint


def parse_blueprint(text: str, library: Library, name: str = "robot.toml") -> Blueprint:
    """Read a blueprint from a text, as a page sends it, and check it against the part library.

    Raises:
        ConfigError: it is wrong; the text names every problem with line and remedy.
    """
    problems = Problems()
    document = parse_document(text, name, problems)
    problems.raise_if_any()
    assert document is not None
    blueprint = _read(document, problems, library, None)
    problems.raise_if_any()
    return blueprint


def _read(document: Document, problems: Problems, library: Library, path: Path | None) -> Blueprint:
    table = Table(document, problems, document.values)
    robot = _read_robot(table.table("robot", required=True))
    timing = _read_timing(table.table("timing"))
    options = _read_options(table.table("options"))
    slot_tables, binding_tables = table.tables("slot"), table.tables("binding")
    slots = [_read_slot(entry) for entry in slot_tables]
    bindings = [_read_binding(entry) for entry in binding_tables]
    table.finish()
    check_slots(table, slot_tables, slots, library)
    check_bindings(binding_tables, bindings, slots, library)
    return Blueprint(robot, tuple(slots), tuple(bindings), timing, options, path)


def _read_robot(table: Table) -> RobotProfile:
    if not table.is_there:
        return RobotProfile("", "", "", "", "")
    robot = RobotProfile(
        name=table.name("name", "MSBOT_MASTER"),
        version=table.name("version", "MSBOT_V1"),
        serial_number=table.name("serial_number", "X100Y100Z100"),
        released=table.name("released", "8-4-2021"),
        manufacturer=table.name("manufacturer", "MASSEY_ENGINEERING_DEP"),
    )
    table.finish()
    return robot


def _read_timing(table: Table) -> Timing:
    preset = PRESETS[table.choice("preset", list(PRESETS), default="thesis")]
    timing = Timing(
        preset=preset.preset,
        beat_period_s=table.number("beat_period_s", default=preset.beat_period_s, least=0.02, most=65.0, unit="s"),
        tick_period_s=table.number("tick_period_s", default=preset.tick_period_s, least=0.02, most=3600.0, unit="s"),
        life=table.whole("life", default=preset.life, least=2, most=255),
        profile_period_s=table.number(
            "profile_period_s", default=preset.profile_period_s, least=0.1, most=3600.0, unit="s"
        ),
    )
    table.finish()
    check_timing(table, timing)
    return timing


def _read_options(table: Table) -> Options:
    options = Options(
        explain=table.flag("explain", default=False),
        free_topics=tuple(table.names("free_topics", "HelloWorldTopic_1_to_2")),
        authentication=table.choice("authentication", list(AUTHENTICATIONS), default="open"),
    )
    table.finish()
    check_free_topics(table, options.free_topics)
    return options


def _read_slot(table: Table) -> Slot:
    slot = Slot(
        name=table.name("name", "AA", forbidden="."),
        part=table.name("part", "ABCD"),
        local_name=table.name("local_name", "ABCD-local", default=""),
        description=table.text("description", "light sensor, 5V"),
        settings=table.scalars("settings"),
    )
    table.finish()
    return slot


def _read_binding(table: Table) -> Binding:
    binding = Binding(
        topic=table.name("topic", "HelloWorldTopic_1_to_2"),
        type_name=table.name("type", "HelloWorld"),
        source=_endpoint(table.name("from", "AA.out")),
        targets=tuple(_endpoint(name) for name in table.names("to", "BB.in", required=True)),
        reliable=table.flag("reliable", default=True),
    )
    table.finish()
    return binding


def _endpoint(name: str) -> Endpoint:
    """`SLOT.port` taken apart; a name without a dot gets no port, which the check then reports."""
    slot, _, port = name.rpartition(".")
    return Endpoint(slot, port) if slot else Endpoint(name, "")
