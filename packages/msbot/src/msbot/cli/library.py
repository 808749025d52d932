"""`msbot library`: the part types that robots are made of."""

from __future__ import annotations

import json
import os
import re
from collections.abc import Iterable, Sequence
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path

import click

from msbot.cli import completers
from msbot.cli.robot_options import library_here, library_option, mistakes_told, robot_and_json_options
from msbot.config import (
    Category,
    Control,
    ControlKind,
    Direction,
    DriverPin,
    DriverSpec,
    Parameter,
    PartType,
    Port,
    Scalar,
    load_library,
    scalar_text,
)
from msbot.config.library.picture import picture_svg
from msbot_agent.cli.options import json_option
from msbot_agent.cli.table import columns_here, table_lines
from msbot_agent.text.similar_names import instead_of
from msbot_agent.text.untrusted_input import read_input_file
from msbot_xrce.counting import amount
from msbot_xrce.errors import ConfigError


@click.group("library")
def command() -> None:
    """The part library: list it, search it, show a part type, check files, add a type of your own."""


@command.command("list")
@click.option("--category", metavar="WORD", help="Only these: sensor, input, actuator, display, power, board, other.")
@library_option
@json_option
def list_types(category: str | None, folders: tuple[Path, ...], *, as_json: bool) -> None:
    """List all part types: number, name, category and ports."""

    types = of_category(library_here(folders), category)
    click.echo(types_json(types) if as_json else types_table(types))


@command.command("search")
@click.argument("words", nargs=-1, required=True)
@library_option
@json_option
def search(words: tuple[str, ...], folders: tuple[Path, ...], *, as_json: bool) -> None:
    """Find part types by WORDS; all must occur, beginnings and near misses count."""
    from msbot.config.library.search import PartSearch

    found = PartSearch(library_here(folders)).find(" ".join(words))
    if as_json:
        click.echo(types_json(found))
    elif found:
        click.echo(types_table(found))
    else:
        click.echo(f"Nothing in the library has all of: {' '.join(words)}. Try fewer words, or `msbot library list`.")


@command.command("show")
@click.argument("number", shell_complete=completers.part_numbers)
@click.option("--picture", metavar="FILE", type=click.Path(path_type=Path), help="Write its picture to an SVG file.")
@library_option
@json_option
def show(number: str, picture: Path | None, folders: tuple[Path, ...], *, as_json: bool) -> None:
    """Show everything about the part type NUMBER: ports, settings, pins, supply, and what its simulator can do."""

    part_type = library_here(folders).require(number)
    if picture is not None:
        write_picture(part_type, picture)
    click.echo(type_json(part_type) if as_json else type_page(part_type))


@command.command("check")
@click.argument("paths", nargs=-1, type=click.Path(path_type=Path))
@json_option
def check(paths: tuple[Path, ...], *, as_json: bool) -> None:
    """Check library files or folders; mistakes are reported with file, line and key.

    Exit status 2 if there are mistakes. Hints name what could be better.
    """

    with mistakes_told(as_json=as_json, hints=[]):
        library = library_here(paths)
    own = [part_type for part_type in library if not part_type.source.startswith("msbot library")]
    told = [f"{part_type.source}: {hint}" for part_type in own or library for hint in hints(part_type)]
    if as_json:
        click.echo(json.dumps({"problems": [], "hints": told}))
        return
    for line in told:
        source, _, hint = line.partition(": ")
        click.echo(f"{source}: hint: {hint}")
    added = f", {len(own)} of them from {', '.join(map(str, paths))}" if paths else ""
    click.echo(f"No mistake: {len(library)} part types{added}, {len(library.messages)} message types.")


@command.command("add")
@click.argument("what", metavar="FILE|NUMBER")
@click.option(
    "--to",
    "folder",
    metavar="FOLDER",
    type=click.Path(path_type=Path),
    default=Path("library"),
    show_default=True,
    help="The robot's own library folder; made if it is not there.",
)
def add(what: str, folder: Path) -> None:
    """Add a part type to a robot's own library folder.

    FILE (it ends in .toml) is checked and copied. A new part NUMBER gets a commented file to fill in. Nothing is
    overwritten.
    """

    path = add_file(Path(what), folder) if what.endswith(".toml") else add_template(what, folder)
    click.echo(f'{path} is written. Name its folder at the top of robot.toml:  library = ["{folder}"]')


@command.command("ros-package")
@click.argument("folder", type=click.Path(path_type=Path))
@click.option("--package", metavar="NAME", help="Name of the ROS package; default: msbot_msgs.")
@library_option
def ros_package(folder: Path, package: str | None, folders: tuple[Path, ...]) -> None:
    """Write the message types and services of the library as a ROS 2 interface package.

    The new FOLDER gets a .msg for each message type and a .srv for each service of a part. Put it into the src of a ROS
    workspace and run `colcon build`; in the blueprint `ros_type` names the service. Its type hash is also in the
    share/PACKAGE/srv/NAME.json of the built package.
    """
    from msbot.cli import ros_package as writer
    from msbot.part.messages.ros_names import PACKAGE, service_stem
    from msbot.part.messages.type_hash import PREFIX
    from msbot.ros2.package_types import service_classes, service_hash
    from msbot.sim.model_part import message_class

    library, package = library_here(folders), package or PACKAGE
    files = writer.package_files(library, package)
    writer.write_package(files, folder)
    services = writer.services_of(library)
    messages = amount(sum(path.startswith("msg/") for path in files), "message")
    click.echo(f"{folder} is written: {messages}, {amount(len(services), 'service')}.")
    for one, (request, reply) in services.items():
        stem = service_stem(*one)
        made = service_classes(message_class(request), message_class(reply), package, stem)
        click.echo(f'  {one}:  ros_type = "{package}/srv/{stem}"  ({PREFIX}{service_hash(*made)[:16]}...)')


@command.command("forget")
@click.argument("number", shell_complete=completers.part_numbers)
@robot_and_json_options
def forget(number: str, db: str | None, robot: str | None) -> None:
    """Remove the adopted part type NUMBER from a running robot's library.

    Remove its slots first: `msbot slot remove SLOT`.
    """
    from msbot.cli.change.robot_access import say

    say(db, robot, "forget_type", {"number": number})


# Puts a part type into a robot's own library folder: a file that exists, or a commented one to fill in.


TEMPLATE = """\
# A part type of this robot. Every key: msbot help reference/library. Check it with:  msbot library check FOLDER
number = "NUMBER"                # what the part shows to its robot
name = "My part"                 # what it is, in a few words
manufacturer = ""
description = ""
specification = ""               # electrical data in words, for example "5V"
category = "other"               # sensor, input, actuator, display, power, board or other
keywords = []                    # words by which `msbot library search` finds it
# compatible_with = ["SG90"]     # part numbers whose slots it can fill as well: it must have all their ports

# [supply]
# min_v = 5
# max_v = 5
# current_ma = 20

# [[pin]]
# name = "VCC"
# kind = "power"                 # power, ground, signal, bus or unused

# Ports: what it says and takes. Message types: msbot help reference/library, or a [[type]] of your own.

[[port]]
name = "value"
direction = "publish"
type = "Number"
rate_hz = 2

# [[port]]
# name = "on"
# direction = "subscribe"
# type = "Switch"
# safe = { on = false }          # what holds when the master or the partner is lost, or on STOP

# Parameters: what can be set for a slot.

# [[parameter]]
# name = "period_s"
# type = "float"                 # bool, int, float or text
# default = 0.5
# min = 0.05
# max = 60
# unit = "s"
# description = "Time between two measurements"

# The simulator: what a person does to the thing, what one sees. Left out, each port gets a knob or a display.

# [[simulator.control]]
# name = "warmth"
# type = "number"
# start = 20
# min = -20
# max = 60
# unit = "°C"
# words = "Warm or cool it"
"""
"""What `msbot library add NUMBER` writes."""

_MOST_BYTES = 256_000
_ODD = re.compile(r"[^A-Za-z0-9._-]")


def add_file(source: Path, folder: Path) -> Path:
    """Check a file together with the library that it will be part of, and copy it; returns the path of the copy.

    Raises:
        ConfigError: it has mistakes, already exists, or cannot be written.
    """
    others = [path for path in sorted(folder.glob("*.toml")) if path.name != source.name]
    load_library(*others, source)
    return _write(folder / source.name, read_input_file(source, _MOST_BYTES, "a part type").decode("utf-8-sig"))


def add_template(number: str, folder: Path) -> Path:
    """Write a template for a new part number; returns its path.

    Raises:
        ConfigError: the number is taken or invalid, or the file already exists or cannot be written.
    """
    if os.sep in number and Path(number).exists():
        raise ConfigError(f"{number} is no part number and no file of a part type: such files end in .toml")
    if not any(map(str.isalnum, number)) or not number.isprintable() or any(sign in number for sign in '@"\\'):
        raise ConfigError(f'{number!r} cannot be a part number: use letters, digits and "-"')
    library = load_library(*([folder] if folder.is_dir() else []))
    if taken := library.get(number):
        raise ConfigError(f"part number {number!r} is taken by {taken.source}; choose another")
    return _write(folder / f"{_ODD.sub('_', number)}.toml", TEMPLATE.replace('"NUMBER"', f'"{number}"'))


def _write(path: Path, text: str) -> Path:
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with path.open("x", encoding="utf-8") as stream:
            stream.write(text)
    except FileExistsError:
        raise ConfigError(f"{path}: exists already and is not overwritten; change it with an editor") from None
    except OSError as error:
        raise ConfigError(f"{path}: cannot be written ({error.strerror}); choose another folder with --to") from None
    return path


# The part library for people: tables, a page about one type, hints; and the same as JSON.


_SAFE_BY_ITSELF = ("Trigger", "HelloWorld")
"""Messages that leave nothing switched on."""


def of_category(types: Iterable[PartType], category: str | None) -> list[PartType]:
    """The types of one category, or all of them.

    Raises:
        ConfigError: there is no such category.
    """
    known = [entry.value for entry in Category]
    if category is not None and category not in known:
        raise ConfigError(f"there is no category {category!r}; {instead_of(category, known)}")
    return [part_type for part_type in types if category in (None, part_type.category.value)]


def types_table(types: Sequence[PartType]) -> str:
    """A table with one line for each type."""
    return _table(
        ("number", "name", "category", "says", "takes"),
        [
            (
                part_type.number,
                part_type.name,
                part_type.category.value,
                _port_words(part_type.ports, Direction.PUBLISH),
                _port_words(part_type.ports, Direction.SUBSCRIBE),
            )
            for part_type in sorted(types, key=lambda entry: entry.number)
        ],
    )


def types_json(types: Sequence[PartType]) -> str:
    """The types as a JSON list."""
    return json.dumps([_as_json(part_type) for part_type in types], ensure_ascii=False)


def type_json(part_type: PartType) -> str:
    """One type as a JSON object."""
    return json.dumps(_as_json(part_type), ensure_ascii=False)


def type_page(part_type: PartType) -> str:
    """Everything about one type."""
    head = [f"{part_type.number}: {part_type.name}", part_type.description]
    facts = [
        ("made by", part_type.manufacturer),
        ("category", part_type.category.value),
        ("electrical", part_type.specification),
        ("resolution", part_type.resolution),
        ("supply", str(part_type.supply or "")),
        ("connector", part_type.connector),
        ("fits slots for", ", ".join((part_type.number, *part_type.compatible_with))),
        ("versions", str(part_type.versions)),
        ("driver", part_type.driver.entry_point or part_type.driver.none),
        ("read from", part_type.source),
    ]
    lines = [line for line in head if line] + [f"  {name:15}{value}" for name, value in facts if value]
    for title, block in _blocks(part_type):
        lines += ["", title, block]
    return "\n".join(lines)


def write_picture(part_type: PartType, path: Path) -> None:
    """Write the picture of a type.

    Raises:
        ConfigError: the file cannot be written.
    """
    try:
        path.write_text(picture_svg(part_type) + "\n", "utf-8")
    except OSError as error:
        raise ConfigError(f"{path}: cannot be written ({error.strerror}); choose another name") from None


def hints(part_type: PartType) -> list[str]:
    """What is correct in a type but could be better."""
    found = []
    for port in part_type.ports:
        if port.direction is Direction.SUBSCRIBE and port.safe is None and port.type_name not in _SAFE_BY_ITSELF:
            found.append(
                f'port "{port.name}" has no safe value: it keeps on when its master is lost; add safe = {{...}}'
            )
    if not part_type.ports:
        found.append("the part has no port: it can join a robot, but neither say nor do anything")
    if fault := _driver_fault(part_type.driver.entry_point):
        found.append(fault)
    return found


def _driver_fault(driver: str) -> str:
    module, _, name = driver.partition(":")
    if not driver:
        return ""
    try:
        found = find_spec(module) is not None and hasattr(import_module(module), name)
    except ImportError:
        found = False
    return "" if found else f"the driver {driver} cannot be found on this computer; install what has it"


def _blocks(part_type: PartType) -> Iterable[tuple[str, str]]:
    if part_type.ports:
        yield (
            "Ports",
            _table(
                ("name", "direction", "message", "how often", "safe value", "means"),
                [_port_row(port) for port in part_type.ports],
            ),
        )
    if part_type.parameters:
        yield (
            "Settings",
            _table(
                ("name", "default", "range", "means"),
                [
                    (entry.name, f"{scalar_text(entry.default)} {entry.unit}".strip(), _range(entry), entry.description)
                    for entry in part_type.parameters
                ],
            ),
        )
    if part_type.pins:
        rows = [(str(at), pin.name, pin.kind.value, pin.description) for at, pin in enumerate(part_type.pins, 1)]
        yield "Pins", _table(("pin", "name", "kind", "means"), rows)
    driver = part_type.driver
    if driver.pins:
        yield (
            "Driver: wires",
            _table(
                ("wire", "pin", "to", "means"),
                [(wire.name, wire.pin, wire_words(wire), wire.description) for wire in driver.pins],
            ),
        )
    if driver.options:
        yield (
            "Driver: options",
            _table(
                ("option", "default", "range", "means"),
                [
                    (entry.name, f"{scalar_text(entry.default)} {entry.unit}".strip(), _range(entry), entry.description)
                    for entry in driver.options
                ],
            ),
        )
    controls = part_type.simulator.controls if part_type.simulator else ()
    if controls:
        yield (
            "Simulator: what you can do",
            _table(
                ("control", "values", "at first", "means"),
                [
                    (control.name, control_values(control), scalar_text(control.start), control.words)
                    for control in controls
                ],
            ),
        )
    readings = [reading for reading in part_type.simulator.readings if reading.shown] if part_type.simulator else []
    if readings:
        yield (
            "Simulator: what you see",
            _table(("reading", "unit", "means"), [(reading.name, reading.unit, reading.words) for reading in readings]),
        )


def wire_words(wire: DriverPin) -> str:
    """Where a wire goes by default."""
    if wire.default is None:
        return "not wired unless told"
    return f"channel {wire.default}" if wire.analog else f"GPIO {wire.default}"


def control_values(control: Control) -> str:
    """The values a control can have, in words."""
    match control.kind:
        case ControlKind.BOOL:
            return "true, false"
        case ControlKind.CHOICE:
            return ", ".join(control.choices)
        case ControlKind.TEXT:
            return "any text"
    words = _between(control.least, control.most)
    return f"{words} {control.unit}".strip() or "any number"


def _port_words(ports: Sequence[Port], direction: Direction) -> str:
    return ", ".join(f"{port.name} ({port.type_name})" for port in ports if port.direction is direction)


def _port_row(port: Port) -> tuple[str, ...]:
    rate = f"{port.rate_hz:g} / s" if port.rate_hz else "on a change" if port.direction is Direction.PUBLISH else ""
    safe = ", ".join(f"{name} = {scalar_text(value)}" for name, value in (port.safe or {}).items())
    direction = "publishes" if port.direction is Direction.PUBLISH else "subscribes"
    return port.name, direction, port.type_name, rate, safe, port.description


def _range(parameter: Parameter) -> str:
    return _between(parameter.least, parameter.most) or parameter.kind.describe


def _between(least: float | None, most: float | None) -> str:
    """A range in words, with the ends that it has; nothing if it has none."""
    if least is None:
        return "" if most is None else f"up to {most:g}"
    return f"from {least:g}" if most is None else f"{least:g} to {most:g}"


def _table(titles: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    return "\n".join(table_lines(titles, rows, columns_here()))


def _as_json(part_type: PartType) -> dict[str, object]:
    simulator = part_type.simulator
    supply = part_type.supply
    return {
        "number": part_type.number,
        "name": part_type.name,
        "manufacturer": part_type.manufacturer,
        "description": part_type.description,
        "specification": part_type.specification,
        "resolution": part_type.resolution,
        "category": part_type.category.value,
        "keywords": list(part_type.keywords),
        "compatible_with": list(part_type.compatible_with),
        "versions": str(part_type.versions),
        "supply": supply and {"min_v": supply.min_v, "max_v": supply.max_v, "current_ma": supply.current_ma},
        "connector": part_type.connector,
        "driver": _driver_json(part_type.driver),
        "source": part_type.source,
        "pins": [{"name": pin.name, "kind": pin.kind.value, "description": pin.description} for pin in part_type.pins],
        "ports": [_port_json(port) for port in part_type.ports],
        "parameters": [_parameter_json(parameter) for parameter in part_type.parameters],
        "controls": [_control_json(control) for control in (simulator.controls if simulator else ())],
        "readings": [
            {"name": reading.name, "unit": reading.unit, "words": reading.words}
            for reading in (simulator.readings if simulator else ())
            if reading.shown
        ],
    }


def _driver_json(driver: DriverSpec) -> dict[str, object] | None:
    if not driver.entry_point:
        return None
    return {
        "class": driver.entry_point,
        "bus": driver.bus.value,
        "pins": [
            {"name": pin.name, "pin": pin.pin, "default": pin.default, "analog": pin.analog, "words": pin.description}
            for pin in driver.pins
        ],
        "addresses": list(driver.addresses),
        "device": driver.device,
        "options": [_parameter_json(option) for option in driver.options],
    }


def _port_json(port: Port) -> dict[str, object]:
    return {
        "name": port.name,
        "direction": port.direction.value,
        "type": port.type_name,
        "fields": {name: kind.word for name, kind in (port.message.fields if port.message else {}).items()},
        "rate_hz": port.rate_hz,
        "safe": None if port.safe is None else dict(port.safe),
        "ranges": {name: list(ends) for name, ends in port.ranges.items()},
        "description": port.description,
    }


def _parameter_json(parameter: Parameter) -> dict[str, Scalar | None]:
    return {
        "name": parameter.name,
        "type": parameter.kind.value,
        "default": parameter.default,
        "unit": parameter.unit,
        "min": parameter.least,
        "max": parameter.most,
        "description": parameter.description,
    }


def _control_json(control: Control) -> dict[str, object]:
    return {
        "name": control.name,
        "type": control.kind.value,
        "start": control.start,
        "min": control.least,
        "max": control.most,
        "unit": control.unit,
        "choices": list(control.choices),
        "momentary": control.momentary,
        "words": control.words,
    }
