"""`msbot part`: one part in a process of its own, simulated or wired to this computer."""

from __future__ import annotations

import sys
from collections.abc import Coroutine
from pathlib import Path
from typing import TYPE_CHECKING

import click

from msbot.cli.robot_options import library_here, library_option, link_option
from msbot.cli.run.world import WorldWishes, bring_into_world, guest_door, place_option, world_option
from msbot.part import Part, SimGpio
from msbot.part.run import run_parts
from msbot.part.sample_parts import SAMPLE_PARTS, make_sample
from msbot_xrce.errors import ConfigError

if TYPE_CHECKING:
    from msbot.sim.arena.door import Door


@click.command("part")
@click.argument("name")
@click.option("--set", "settings", metavar="CONTROL=VALUE", multiple=True,
              help="Do something to the simulated thing before it starts; may be given several times.")  # fmt: skip
@click.option("--pins", metavar="NAME=GPIO,...", help="It is real, on these GPIO pins (BCM numbers).")
@click.option("--i2c", metavar="BUS:ADDRESS", help="It is real, on that I2C bus, for example 1:0x76.")
@click.option("--adc", metavar="NAME=CHANNEL,...",
              help="It is real, at these channels of a converter; 1:0 is channel 0 of iio:device1.")  # fmt: skip
@click.option("--device", metavar="PATH", help="It is real, at that device: a serial port, an SPI, a 1-Wire id.")
@click.option("--real", is_flag=True, help="It is real, and wired as `msbot library show` says.")
@click.option("--simulate", is_flag=True,
              help="It stands in for the real one: NAME may be a slot of robot.toml here.")  # fmt: skip
@click.option("--option", "options", metavar="NAME=VALUE", multiple=True,
              help="Something about the real thing, as calibration; may be given several times.")  # fmt: skip
@click.option("--name", "local_name", metavar="LOCAL",
              help="What this one is called; the part number if absent.")  # fmt: skip
@link_option
@click.option("--uid", help="16 hexadecimal digits; drawn once and kept on this computer unless given.")
@click.option("--key", help="File with the part's key, or the key itself; $MSBOT_KEY unless given.")
@world_option
@place_option
@library_option
@click.option("-q", "--quiet", is_flag=True, help="Say only what is wrong.")
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

    It recognises its robot, registers, beats and does its work. It is simulated unless it is said where it is wired:
    `msbot part HC-SR04 --pins trigger=23,echo=24`, `msbot part BMP280 --i2c 1:0x76`. While a simulated one runs, type
    CONTROL=VALUE to do something to it, for example press=true at a BUTTON; `msbot library show NUMBER` lists controls,
    wires and options.
    """
    is_wired = real or options or any(text is not None for text in (pins, i2c, adc, device))
    if is_wired and simulate:
        raise ConfigError("a simulated part has no wires: leave --simulate out, or the wires and options")
    WorldWishes(world, place).check()
    if world is not None and (is_wired or name in SAMPLE_PARTS):
        raise ConfigError("only a simulated part of the library can be in a world: leave --world out")
    slot = name
    door = None if world is None else guest_door(world, place, click.echo)
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
    from msbot.cli.robot_options import DEFAULT_BLUEPRINT
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
    from msbot.cli.run.hosting import connect, identify, run_until_told
    from msbot.hardware import HardwarePart, Workbench, make_wiring

    part_type = library_here(folders).require(number)
    wiring = make_wiring(
        part_type, pins=wires["pins"], adc=wires["adc"], i2c=wires["i2c"], device=wires["device"], options=options
    )
    bench = Workbench()

    def make() -> tuple[HardwarePart, Coroutine[object, object, None]]:
        unit = bench.make(part_type, wiring, number=number, name=local_name)
        identify(unit.part, uid=uid, key=key)
        return unit, unit.run(lambda: connect(unit.part, link))

    if not quiet:
        click.echo(f"{part_type.name}: {wiring.words() or 'this computer'}")
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
    number: str, settings: tuple[str, ...], local_name: str | None, folders: tuple[Path, ...], *,
    door: Door | None, slot: str, quiet: bool,
) -> Part:  # fmt: skip
    from msbot.cli.run.part_console import PartConsole, apply_settings, controls_words
    from msbot.sim import make_simulator

    simulated = make_simulator(number, local_name=local_name, library=library_here(folders))
    apply_settings(simulated, settings)
    if door is not None:
        bring_into_world(simulated, local_name or slot, door)
    if not quiet:
        PartConsole(simulated, click.echo, sys.stdin)
        click.echo(f"{simulated.part_type.name}; {controls_words(simulated)}")
    return simulated.part
