"""`msbot part`: one part in a process of its own, simulated or wired to this computer."""

from __future__ import annotations

import asyncio
import contextlib
import os
import sys
from collections.abc import Callable, Coroutine, Iterable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, TextIO

import click

from msbot.cli import completers
from msbot.cli.robot_options import library_here, library_option, link_option
from msbot.cli.run.world_options import WorldOptions, place_option, put_into_world, remote_world, world_option
from msbot.config import Reading, Scalar, scalar_text
from msbot.part import Part, SimGpio
from msbot.part.run import run_parts
from msbot.part.sample_parts import SAMPLE_PARTS, make_sample
from msbot.sim import SimulatedPart
from msbot_xrce.errors import ConfigError

if TYPE_CHECKING:
    from msbot.sim.arena.world_connection import WorldConnection


@click.command("part")
@click.argument("name", shell_complete=completers.part_numbers)
@click.option(
    "--set",
    "settings",
    metavar="CONTROL=VALUE",
    multiple=True,
    help="Operate a control of the simulated part before it starts; repeatable.",
)
@click.option("--pins", metavar="NAME=GPIO,...", help="A real part, at these GPIO pins (BCM numbers).")
@click.option("--i2c", metavar="BUS:ADDRESS", help="A real part, at this I2C bus and address, for example 1:0x76.")
@click.option(
    "--adc",
    metavar="NAME=CHANNEL,...",
    help="A real part, at these channels of a converter; 1:0 is channel 0 of iio:device1.",
)
@click.option(
    "--device", metavar="PATH", help="A real part, at this device: a serial port, an SPI device, a 1-Wire id."
)
@click.option("--real", is_flag=True, help="A real part, wired as `msbot library show` says.")
@click.option(
    "--simulate",
    is_flag=True,
    help="Simulate it in place of the real part, with a UID of its own; NAME may also be a slot.",
)
@click.option(
    "--option",
    "options",
    metavar="NAME=VALUE",
    multiple=True,
    help="A value of the real part, such as calibration; repeatable.",
)
@click.option("--name", "local_name", metavar="LOCAL", help="Its local name; default: the part number.")
@link_option
@click.option(
    "--uid", help="UID, 16 hexadecimal digits; default: random at the first start, then kept on this computer."
)
@click.option("--key", help="File with the part's key, or the key itself; default: $MSBOT_KEY.")
@world_option
@place_option
@library_option
@click.option("-q", "--quiet", is_flag=True, help="Print only problems.")
def command(
    name: str,
    *,
    settings: tuple[str, ...],
    pins: str | None,
    i2c: str | None,
    adc: str | None,
    device: str | None,
    real: bool,
    simulate: bool,
    options: tuple[str, ...],
    local_name: str | None,
    link: str,
    uid: str | None,
    key: str | None,
    world: str | None,
    place: str | None,
    folders: tuple[Path, ...],
    quiet: bool,
) -> None:
    """Run a part until Ctrl-C: any part number of the library, or AA, BB or CC of the sample robot.

    It is simulated unless an option says how it is wired: `msbot part HC-SR04 --pins trigger=23,echo=24`, `msbot part
    BMP280 --i2c 1:0x76`. While a simulated part runs, type CONTROL=VALUE to operate it, for example press=true at a
    BUTTON; `msbot library show NUMBER` lists controls, wires and options.

    AA, BB and CC join only a robot of the name MSBOT_MASTER; their part numbers, ABCD, EFGH and WXYZ, join any robot.
    """
    is_wired = real or options or any(text is not None for text in (pins, i2c, adc, device))
    if is_wired and simulate:
        raise ConfigError("a simulated part has no wires: leave --simulate out, or the wires and options")
    WorldOptions(world, place).check()
    if world is not None and (is_wired or name in SAMPLE_PARTS):
        raise ConfigError("only a simulated part of the library can be in a world: leave --world out")
    slot = name
    door = None if world is None else remote_world(world, place, click.echo)
    if simulate and name not in SAMPLE_PARTS:
        name, local_name, uid = _stand_in(name, local_name, uid, folders, quiet=quiet)
    if is_wired:
        if settings:
            raise ConfigError("--set does something to a simulated thing; a real one has hands and air around it")
        wires = {"pins": pins or "", "i2c": i2c or "", "adc": adc or "", "device": device or ""}
        _run_real(name, wires, options, local_name, folders, link=link, uid=uid, key=key, quiet=quiet)
        return
    if name in SAMPLE_PARTS:
        if settings or local_name is not None:
            raise ConfigError(
                f"{name} is a part of the sample robot and has no controls and one name; run its part number instead: "
                f"msbot part {SAMPLE_PARTS[name].part_number}"
            )
        part = _sample(name, quiet=quiet)
    else:
        part = _simulated(name, settings, local_name, folders, door=door, slot=slot, quiet=quiet)
    run_parts([part], link=link, uid=uid, key=key, quiet=quiet)


def _stand_in(
    name: str, local_name: str | None, uid: str | None, folders: tuple[Path, ...], *, quiet: bool
) -> tuple[str, str, str]:
    """Part number, local name and UID of a simulated part for a slot of the robot.toml here, or for a part number."""
    from msbot.cli.database_place import DEFAULT_BLUEPRINT
    from msbot.config import open_blueprint
    from msbot.part.join.uid import stored_uid

    slots = {}
    if DEFAULT_BLUEPRINT.is_file():
        blueprint, _ = open_blueprint(DEFAULT_BLUEPRINT, *folders)
        slots = {slot.name: slot for slot in blueprint.slots}
    slot = slots.get(name)
    number = name if slot is None else slot.part_number
    if slot is None:
        library_here(folders).require(number)
    called = local_name or (number if slot is None else slot.wanted_name)
    # Not the UID of the real one: both may be present, and the robot must be able to distinguish them.
    uid = uid or stored_uid(number, f"{called}, simulated").hex()
    if slot is not None and not quiet:
        click.echo(f"For slot {name}; while another part holds it: msbot swap {name} --to {uid}")
    return number, called, uid


def _run_real(
    number: str,
    wires: dict[str, str],
    options: tuple[str, ...],
    local_name: str | None,
    folders: tuple[Path, ...],
    *,
    link: str,
    uid: str | None,
    key: str | None,
    quiet: bool,
) -> None:
    from msbot.cli.run.host import connect, identify, run_until_told
    from msbot.hardware import HardwarePart, HardwareParts, make_wiring

    part_type = library_here(folders).require(number)
    wiring = make_wiring(
        part_type, pins=wires["pins"], adc=wires["adc"], i2c=wires["i2c"], device=wires["device"], options=options
    )
    bench = HardwareParts()

    def make() -> tuple[HardwarePart, Coroutine[object, object, None]]:
        unit = bench.make(part_type, wiring, number=number, name=local_name)
        identify(unit.part, uid=uid, key=key)
        return unit, unit.run(lambda: connect(unit.part, link))

    if not quiet:
        click.echo(f"{part_type.name}: {wiring.describe() or 'this computer'}")
    try:
        run_until_told(make, quiet=quiet)
    finally:
        bench.end()


def _sample(name: str, *, quiet: bool) -> Part:
    board = SimGpio()
    if not quiet:
        board.on_change(lambda pin, level: click.echo(f"output {pin} is {'on' if level else 'off'}"))
    return make_sample(name, board=board)


def _simulated(
    number: str,
    settings: tuple[str, ...],
    local_name: str | None,
    folders: tuple[Path, ...],
    *,
    door: WorldConnection | None,
    slot: str,
    quiet: bool,
) -> Part:
    from msbot.sim import make_simulator

    simulated = make_simulator(number, local_name=local_name, library=library_here(folders))
    apply_settings(simulated, settings)
    if door is not None:
        put_into_world(simulated, local_name or slot, door)
    if not quiet:
        PartConsole(simulated, click.echo, sys.stdin)
        click.echo(f"{simulated.part_type.name}; {controls_words(simulated)}")
    return simulated.part


# The console of a simulated part: prints what changes, and takes what a person types, `control=value`.


LOOK_S = 0.2
"""Period in which readings are checked for changes."""
MOST_TYPED = 4096
"""Most octets read from the terminal at once, and most characters of a line."""
SHARE = 0.02
SIGMAS = 8
"""A number is printed again when it has changed by more than a share of itself and by this multiple of its noise;
without noise also when it comes to rest at a value other than the one printed: the last small step of a ramp."""


class PartConsole:
    """Watches one simulated part.

    Args:
        simulated: the part.
        say: prints a line.
        source: where typed lines come from; None = nobody types.
    """

    def __init__(self, simulated: SimulatedPart, say: Callable[[str], None], source: TextIO | None = None) -> None:
        self._simulated = simulated
        self._say = say
        self._source = source
        self._listening = False
        self._unfinished = ""
        self._said: dict[str, Scalar] = {}
        self._seen: dict[str, Scalar] = {}
        """The readings at the last look."""
        spec = simulated.part_type.simulator
        self._readings: dict[str, Reading] = {} if spec is None else {entry.name: entry for entry in spec.readings}
        part = simulated.part
        part.on_join(self._listen)
        part.on_lost(self.print_changes)
        part.every(LOOK_S)(self.print_changes)

    def print_changes(self) -> None:
        """Print which readings have changed."""
        readings = self._simulated.readings()
        changed = {name: value for name, value in readings.items() if self._is_news(name, value)}
        self._seen = dict(readings)
        if changed:
            self._said |= changed
            self._say(", ".join(self._words(name, value) for name, value in changed.items()))

    def typed(self, line: str) -> None:
        """Do what a person typed; invalid input is answered with a sentence."""
        if not line.strip():
            return
        try:
            apply_settings(self._simulated, [line.strip()])
        except ConfigError as error:
            self._say(str(error))
        self.print_changes()

    def _is_news(self, name: str, value: Scalar) -> bool:
        before = self._said.get(name)
        if isinstance(value, float) and isinstance(before, float):
            noise = self._readings[name].noise
            least = 0.0 if isinstance(noise, str) else SIGMAS * noise
            if least == 0.0 and value == self._seen.get(name):
                return self._words(name, value) != self._words(name, before)
            return abs(value - before) > max(least, SHARE * max(abs(value), abs(before)))
        return value != before

    def _words(self, name: str, value: Scalar) -> str:
        unit = self._readings[name].unit
        text = f"{value:.4g}" if isinstance(value, float) else scalar_text(value)
        return f"{name} {text} {unit}".rstrip()

    def _listen(self) -> None:
        if self._listening or self._source is None or not _is_ours(self._source):
            return
        self._listening = True
        # A file that is not a terminal or pipe, or a loop that cannot watch one: then nobody types.
        with contextlib.suppress(OSError, ValueError, NotImplementedError):
            asyncio.get_running_loop().add_reader(self._source, self._hear)

    def _hear(self) -> None:
        assert self._source is not None
        if not _is_ours(self._source):
            asyncio.get_running_loop().remove_reader(self._source)
            return
        # Not readline: what it reads ahead would wait for the next time something is typed.
        typed = os.read(self._source.fileno(), MOST_TYPED).decode(errors="replace")
        if not typed:
            asyncio.get_running_loop().remove_reader(self._source)
        self.execute_lines(typed)

    def execute_lines(self, typed: str) -> None:
        """Do what each line says that is whole now."""
        *lines, self._unfinished = (self._unfinished + typed).split("\n")
        for line in lines:
            if len(line) > MOST_TYPED:
                self._say(f"a line of more than {MOST_TYPED} characters is left out: write CONTROL=VALUE")
            else:
                self.typed(line)
        self._unfinished = self._unfinished[: MOST_TYPED + 1]  # too long already, whatever follows


def _is_ours(source: TextIO) -> bool:
    """Whether this program may read: one in the background that reads from its terminal would be stopped."""
    if sys.platform == "win32" or not source.isatty():
        return True
    try:
        return os.tcgetpgrp(source.fileno()) == os.getpgrp()
    except OSError:
        return True  # a terminal, but not the one this program was started from, so reading does not stop it


def apply_settings(simulated: SimulatedPart, settings: Iterable[str]) -> None:
    """Set controls from texts such as `press=true`.

    Raises:
        ConfigError: a text has no equals sign, there is no such control, or it cannot have that value.
    """
    for text in settings:
        name, sign, value = text.partition("=")
        if not sign:
            raise ConfigError(f"{text!r} sets nothing: write CONTROL=VALUE; {controls_words(simulated)}")
        control = simulated.control(name.strip())
        simulated.set(control.name, control.parse(value.strip()))


def controls_words(simulated: SimulatedPart) -> str:
    """The controls that can be set, in a sentence."""
    from msbot.cli.library import control_values

    known: Mapping[str, str] = {control.name: control_values(control) for control in simulated.controls}
    listed = "; ".join(f"{name} ({values})" for name, values in known.items())
    return f"controls: {listed}" if listed else "this part has no controls"
