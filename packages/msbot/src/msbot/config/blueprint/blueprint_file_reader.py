"""Reads `robot.toml`, the blueprint of a robot, and checks it against the part library."""

from __future__ import annotations

from pathlib import Path

from msbot.config.blueprint.blueprint_model import (
    AUTHENTICATIONS,
    NOBODY,
    PRESETS,
    ROS_PARAMETERS,
    Binding,
    Blueprint,
    BridgeTable,
    InDds,
    Options,
    RobotProfile,
    RosOptions,
    Slot,
    SlotPort,
    Timing,
)
from msbot.config.blueprint.check import check_bindings, check_free_topics, check_slots, check_timing
from msbot.config.library.part_library import Library, load_library
from msbot.config.library.part_types import PartType, scalar_text
from msbot.config.library.safe_values import read_safe
from msbot.stop.socket_names import group_in
from msbot_agent.ros.node_names import GLOBAL_TOPICS, is_topic
from msbot_agent.text.sentence import said
from msbot_agent.toml.document import Document, parse_document, read_document
from msbot_agent.toml.problems import Problems, quoted
from msbot_agent.toml.table import Scalar, Table
from msbot_xrce.errors import ConfigError

ADOPTED = "adopted"
"""The folder beside a blueprint where the robot keeps the part types that it has adopted; it is read by itself."""


def open_blueprint(path: Path, *folders: Path) -> tuple[Blueprint, Library]:
    """Read a blueprint with its library: MsBOT's own part types, those it names itself, and those of `folders`.

    Raises:
        ConfigError: file or library cannot be read, or are wrong; the text names every problem with line and remedy.
    """
    problems = Problems()
    document = _open(path, problems)
    named = _read_library(Table(document, problems, document.values))
    problems.raise_if_any()
    library = load_library(*(path.parent / folder for folder in named), *_adopted(path), *folders)
    return _checked(document, problems, library, path), library


def library_folders(path: Path) -> tuple[Path, ...]:
    """The folders that a blueprint names, for commands that need only the library; none if there is no file.

    Raises:
        ConfigError: the file cannot be read.
    """
    if not path.is_file():
        return ()
    problems = Problems()
    document = _open(path, problems)
    named = _read_library(Table(document, problems, document.values))
    problems.raise_if_any()
    return (*(path.parent / folder for folder in named), *_adopted(path))


def load_blueprint(path: Path, library: Library) -> Blueprint:
    """Read a blueprint and check it against a part library that has already been read.

    Raises:
        ConfigError: the file cannot be read, or is wrong; the text names every problem with line and remedy.
    """
    problems = Problems()
    return _checked(_open(path, problems), problems, library, path)


def parse_blueprint(text: str, library: Library, name: str = "robot.toml") -> Blueprint:
    """Read a blueprint from a text, as a page sends it, and check it against the part library.

    Raises:
        ConfigError: it is wrong; the text names every problem with line and remedy.
    """
    problems = Problems()
    document = parse_document(text, name, problems)
    problems.raise_if_any()
    assert document is not None
    return _checked(document, problems, library, None)


def _adopted(path: Path) -> tuple[Path, ...]:
    folder = path.parent / ADOPTED
    return (folder,) if folder.is_dir() else ()


def _open(path: Path, problems: Problems) -> Document:
    document = read_document(
        path, problems, if_missing=said("`msbot init {path}` writes a sample robot there", path=str(path))
    )
    problems.raise_if_any()
    assert document is not None
    return document


def _checked(document: Document, problems: Problems, library: Library, path: Path | None) -> Blueprint:
    blueprint = _read(document, problems, library, path)
    problems.raise_if_any()
    return blueprint


def _read(document: Document, problems: Problems, library: Library, path: Path | None) -> Blueprint:
    table = Table(document, problems, document.values)
    folders = _read_library(table)
    robot = _read_robot(table.table("robot", required=True))
    timing = _read_timing(table.table("timing"))
    options = _read_options(table.table("options"))
    ros = _read_ros(table.table("ros"))
    bridges = [_read_bridge(entry) for entry in table.tables("bridge")]
    slot_tables, binding_tables = table.tables("slot"), table.tables("binding")
    slots = [_read_slot(entry, library) for entry in slot_tables]
    bindings = [_read_binding(entry) for entry in binding_tables]
    table.finish()
    check_slots(table, slot_tables, slots, library)
    check_bindings(binding_tables, bindings, slots, library)
    return Blueprint(robot, tuple(slots), tuple(bindings), timing, options, folders, path, ros, tuple(bridges))


def _read_library(table: Table) -> tuple[str, ...]:
    return tuple(table.names("library", "parts"))


def _read_robot(table: Table) -> RobotProfile:
    if not table.is_there:
        return RobotProfile("")
    usual = RobotProfile("")
    robot = RobotProfile(
        name=table.name("name", "MSBOT_MASTER"),
        version=table.name("version", "MSBOT_V1", default=usual.version),
        serial_number=table.name("serial_number", "X100Y100Z100", default=usual.serial_number),
        released=table.name("released", "8-4-2021", default=usual.released),
        manufacturer=table.name("manufacturer", "MASSEY_ENGINEERING_DEP", default=usual.manufacturer),
        stop_group=_read_group(table),
    )
    table.finish()
    return robot


def _read_group(table: Table) -> str:
    group = table.text("stop_group", "bench-1")
    try:
        return group_in(group)
    except ConfigError as error:
        table.report(str(error), "stop_group")
        return ""


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
    authentication = table.choice("authentication", list(AUTHENTICATIONS), default="open")
    options = Options(
        # In a classroom, unexplained silence costs an hour; a robot with keys tells strangers nothing.
        explain=table.flag("explain", default=authentication == "open"),
        free_topics=tuple(table.names("free_topics", "HelloWorldTopic_1_to_2")),
        authentication=authentication,
    )
    table.finish()
    check_free_topics(table, options.free_topics)
    return options


def _read_ros(table: Table) -> RosOptions:
    ros = RosOptions(
        urdf=table.text("urdf", "rover.urdf"),
        clock=table.flag("clock", default=False),
        parameters=table.choice("parameters", list(ROS_PARAMETERS), default=ROS_PARAMETERS[0]),
        global_topics=tuple(name.removeprefix("/") for name in table.names("global_topics", "/diagnostics")),
    )
    for name in ros.global_topics:
        if name not in GLOBAL_TOPICS:
            table.report(said('"{value}" is none of {words}', value=name, words=quoted(GLOBAL_TOPICS)), "global_topics")
    table.finish()
    return ros


def _read_bridge(table: Table) -> BridgeTable:
    bridge = BridgeTable(
        world=table.name("world", "canopen"),
        link=table.name("link", "socketcan:can0"),
        options={name: scalar_text(value) for name, value in table.scalars("options").items()},
        simulate=tuple(table.names("simulate", "drive")),
    )
    table.finish()
    return bridge


def _read_slot(table: Table, library: Library) -> Slot:
    name, part_number = table.name("name", "AA", forbidden="."), table.name("part", "ABCD")
    slot = Slot(
        name=name,
        part_number=part_number,
        local_name=table.name("local_name", "ABCD-local", default=""),
        description=table.text("description", "light sensor, 5V"),
        settings=table.scalars("settings"),
        safe=_read_safe(table.table("safe"), library.get(part_number)),
    )
    table.finish()
    return slot


def _read_safe(table: Table, part_type: PartType | None) -> dict[str, dict[str, Scalar]]:
    """The safe values of a slot, by port; `check_slots` says what is wrong with them."""
    found = {}
    for name in table.present_keys():
        port = None if part_type is None else part_type.port(name)
        found[name] = read_safe(table.table(name), None if port is None else port.message)
    return found


def _read_binding(table: Table) -> Binding:
    binding = Binding(
        topic=table.name("topic", "HelloWorldTopic_1_to_2"),
        type_name=table.name("type", "HelloWorld"),
        source=_source(table),
        targets=tuple(_endpoint(name) for name in table.names("to", "BB.in", required=True)),
        reliable=table.flag("reliable", default=True),
        in_dds=_in_dds(table),
    )
    table.finish()
    if table.scalar("from") == "" and table.is_empty("to"):
        table.report(said('joins no port: name who publishes, for example from = "AA.out", or who subscribes'), "from")
    return binding


def _in_dds(table: Table) -> InDds:
    fields = table.table("ros_fields")
    found = InDds(
        export=table.flag("export", default=False),
        ros=table.flag("ros", default=False),
        ros_type=table.text("ros_type", "std_msgs/msg/Float32"),
        ros_fields=tuple((name, fields.text(name, "data")) for name in fields.present_keys()),
        ros_topic=table.text("ros_topic", "/cmd_vel"),
    )
    fields.finish()
    if found.ros_topic and not is_topic(found.ros_topic):
        table.report(said("ROS 2 takes no topic of that name: names consist of letters, digits, _ and /"), "ros_topic")
    if not found.ros:
        for key in ("ros_type", "ros_fields", "ros_topic"):
            if key in table:
                table.report(said("says how ROS 2 sees the topic: add ros = true"), key)
    return found


def _source(table: Table) -> SlotPort:
    if table.scalar("from") == "":
        return NOBODY
    return _endpoint(table.name("from", "AA.out"))


def _endpoint(name: str) -> SlotPort:
    """Split `SLOT.port`; a name without a dot gets no port, which the check then reports."""
    slot, _, port = name.rpartition(".")
    return SlotPort(slot, port) if slot else SlotPort(name, "")
