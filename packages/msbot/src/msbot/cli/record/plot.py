"""`msbot plot`: curves of a running robot or of a recording, in the terminal or as a picture; and one CAN frame."""

from __future__ import annotations

import csv
import shutil
import sys
import time
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING

import click

from msbot.cli import completers
from msbot.cli.change.robot_access import perform
from msbot.cli.record.log import SUFFIX
from msbot.cli.robot_options import library_option, robot_options
from msbot_agent.cli.exit_status import ExitStatus
from msbot_agent.cli.options import FiniteRange, WholeRange
from msbot_agent.text.sentence import as_cell, printable
from msbot_agent.text.similar_names import did_you_mean
from msbot_xrce.counting import amount
from msbot_xrce.errors import ConfigError, LocalProtocolError
from msbot_xrce.lazy import dataclass

if TYPE_CHECKING:
    from msbot.recording.curves.curve import Curve
    from msbot.recording.curves.curve_reader import ReadCurves, UnitOf

TABLE = ".csv"
SECONDS = 30.0
MOST_CURVES = 20
JUST_NOW_S = 0.8
"""What a robot has said is in the ring's file after at most this time."""
WATCH_S = 1.0
LEAST_HEIGHT = 12


@dataclass(frozen=True, slots=True)
class _Wish:
    names: tuple[str, ...]
    file: Path | None
    seconds: float | None
    from_s: float | None
    to_s: float | None


@click.command("plot")
@click.argument("what", nargs=-1, shell_complete=completers.recordings, metavar="[FILE.mcap] [CURVE]...")
@click.option(
    "--seconds",
    type=FiniteRange(min=1),
    metavar="N",
    help=f"The last N seconds of the robot that runs here; default: {SECONDS:g}.",
)
@click.option("--from", "from_s", type=FiniteRange(min=0), metavar="SECONDS", help="Of a file: from this time on.")
@click.option("--to", "to_s", type=FiniteRange(min=0), metavar="SECONDS", help="Of a file: until this time.")
@click.option("--watch", is_flag=True, help="Draw again every second, until Ctrl-C.")
@click.option(
    "--out",
    type=click.Path(path_type=Path),
    metavar="FILE",
    help="Write a picture (.png, .svg, .pdf) or a table (.csv).",
)
@click.option("--frame", metavar="101#C010", help="Draw this CAN frame as CAN-H and CAN-L, stuff bits marked.")
@click.option(
    "--bitrate",
    type=WholeRange(1_000, 1_000_000),
    default=500_000,
    show_default=True,
    help="Of --frame: bits a second.",
)
@click.option(
    "--data-bitrate",
    type=WholeRange(1_000, 8_000_000),
    default=2_000_000,
    show_default=True,
    help="Of --frame: bits a second in the data phase of CAN FD.",
)
@library_option
@robot_options
def command(
    what: tuple[str, ...],
    *,
    seconds: float | None,
    from_s: float | None,
    to_s: float | None,
    watch: bool,
    out: Path | None,
    frame: str | None,
    bitrate: int,
    data_bitrate: int,
    folders: tuple[Path, ...],
    db: str | None,
    robot: str | None,
) -> None:
    """Draw curves of the robot that runs here, or of a recording.

    A CURVE is a field (knob.level.percent), a port or a slot with all it has (knob.level, knob), a setting
    (ear:threshold), @bus, @frames, @late, @latency, @beat.SLOT or @ack.SLOT. Without a CURVE, lists what can be drawn.
    """
    if out is not None and out.exists():
        raise ConfigError(f"{out} is there already: give the file another name")
    if frame is not None:
        if what or watch:
            raise click.UsageError("--frame is drawn alone: leave curves and --watch out")
        _draw_frame(frame, bitrate, data_bitrate, out)
        return
    files = [Path(one) for one in what if one.lower().endswith(SUFFIX)]
    if len(files) > 1:
        raise click.UsageError("one recording at a time")
    wish = _Wish(
        tuple(one for one in what if not one.lower().endswith(SUFFIX)),
        files[0] if files else None,
        seconds,
        from_s,
        to_s,
    )
    _check(wish, watch=watch, out=out)
    unit_of = _units(folders)
    folder = None if wish.file is not None else _ring(db, robot)
    if not watch:
        if folder is not None:
            time.sleep(JUST_NOW_S)  # until the last moment is in the file
        read, zero_s = _read(wish, folder, unit_of)
        _show(read, zero_s, wish, out)
        if folder is None and read.damages:  # the newest file of a ring has no end yet
            sys.exit(ExitStatus.NO)
        return
    with suppress(KeyboardInterrupt):
        while True:
            read, zero_s = _read(wish, folder, unit_of)
            click.clear()
            _show(read, zero_s, wish, None)
            time.sleep(WATCH_S)


def _check(wish: _Wish, *, watch: bool, out: Path | None) -> None:
    if wish.file is None and (wish.from_s is not None or wish.to_s is not None):
        raise click.UsageError("--from and --to are for a recording: name the file, or say --seconds N")
    if wish.file is not None and (wish.seconds is not None or watch):
        raise click.UsageError("--seconds and --watch are for the robot that runs here: use --from and --to for a file")
    if watch and out is not None:
        raise click.UsageError("--watch draws in the terminal: leave --out out")
    if watch and not wish.names:
        raise click.UsageError("--watch: say which curves")
    if out is not None:
        from msbot.recording.curves.curve_drawing import PICTURES

        if out.suffix.lower() not in (*PICTURES, TABLE):
            raise click.UsageError(f"--out {out}: a file that ends with {', '.join(PICTURES)} or {TABLE}")
        if not wish.names:
            raise click.UsageError("--out: say which curves")


def _ring(db: str | None, robot: str | None) -> Path:
    folder = perform(db, robot, "recording", {}).get("folder")
    if not folder:
        raise ConfigError("this robot runs with `--rec off`: nothing of its past is known")
    return Path(str(folder))


def _units(folders: tuple[Path, ...]) -> UnitOf:
    from msbot.config import load_library
    from msbot.recording.curves.curve_reader import units_of

    return units_of(load_library(*folders))


def _read(wish: _Wish, folder: Path | None, unit_of: UnitOf) -> tuple[ReadCurves, float]:
    """What was asked for, and which time is 0."""
    from msbot.recording.curves.curve_reader import read_curves, ring_files
    from msbot.recording.recordings.mcap_reader import began_ns, ended_ns
    from msbot.recording.recordings.summary import unread_words

    if folder is None:
        assert wish.file is not None
        zero_s = began_ns(wish.file) / 1e9
        begin_s = None if wish.from_s is None else zero_s + wish.from_s
        end_s = None if wish.to_s is None else zero_s + wish.to_s
        read = read_curves([wish.file], wish.names, from_s=begin_s, to_s=end_s, unit_of=unit_of)
        for damage in read.damages:
            click.echo(f"msbot: {damage}", err=True)
    else:
        # Not the time of this computer: its clock may have been set since the robot began.
        zero_s = ended_ns(ring_files(folder)) / 1e9
        begin_s = zero_s - (wish.seconds or SECONDS)
        read = read_curves(ring_files(folder, begin_s), wish.names, from_s=begin_s, unit_of=unit_of)
    if folder is None and (words := unread_words(read.unread)):
        click.echo(words, err=True)
    for name in wish.names:
        _check_name(name, read, folder)
    if len(read.curves) > MOST_CURVES:
        raise ConfigError(
            f"these are {len(read.curves)} curves, at most {MOST_CURVES} can be drawn: "
            f"choose among {', '.join(curve.name for curve in read.curves)}"
        )
    return read, zero_s


def _check_name(name: str, read: ReadCurves, folder: Path | None) -> None:
    from msbot.recording.curves.curve import close_names, is_wanted

    if any(is_wanted(curve.name, [name]) and curve.points for curve in read.curves):
        return
    if any(is_wanted(one, [name]) for one in read.known):
        raise ConfigError(f"{name} has no value in that time: choose a longer one")
    close = close_names(name, read.known)
    hint = did_you_mean(close) if close else "`msbot plot` without a name lists what there is"
    place = "in that time of the robot" if folder is not None else "in the recording"
    raise ConfigError(f"there is no curve {name!r} {place}; {hint}")


def _show(read: ReadCurves, zero_s: float, wish: _Wish, out: Path | None) -> None:
    from msbot.recording.curves.curve_drawing import save_picture, terminal_plot

    if not wish.names:
        if not read.known:
            raise ConfigError("there is nothing to draw in that time")
        click.echo("\n".join(map(printable, read.known)))
        return
    curves = [curve for curve in read.curves if curve.points]
    if out is not None:
        if out.suffix.lower() == TABLE:
            _write_table(curves, out, zero_s)
        else:
            title = f"the last {wish.seconds or SECONDS:g} s" if wish.file is None else wish.file.name
            save_picture(curves, out, zero_s=zero_s, title=title)
        values = sum(len(curve.points) for curve in curves)
        click.echo(f"{out}: {amount(len(curves), 'curve')}, {amount(values, 'value')}")
        return
    size, colour = shutil.get_terminal_size((100, 30)), sys.stdout.isatty()
    height = max(size.lines - len(curves) - 4, LEAST_HEIGHT)
    click.echo(terminal_plot(curves, zero_s=zero_s, width=size.columns, height=height, colour=colour), color=colour)
    _print_figures(read, curves, colour=colour)


def _print_figures(read: ReadCurves, curves: list[Curve], *, colour: bool) -> None:
    from msbot.recording.curves.curve_drawing import by_unit, figure_rows, terminal_colour, terminal_letter

    alone = {group[0].name for group in by_unit(curves).values() if len(group) == 1}
    rows = [("curve", "values", "mean", "least", "most", "last", "unit"), *figure_rows(curves, read.figures)]
    widths = [max(len(row[column]) for row in rows) for column in range(len(rows[0]))]
    numbers = {curve.name: number for number, curve in enumerate(curves)}
    for row in rows:
        cells = [
            cell.ljust(width) if column in (0, 6) else cell.rjust(width)
            for column, (cell, width) in enumerate(zip(row, widths, strict=True))
        ]
        number = numbers.get(row[0])
        if number is not None and colour:
            cells[0] = click.style(cells[0], fg=f"bright_{terminal_colour(number)}")
        letter = " " if number is None or row[0] in alone else terminal_letter(number)
        click.echo("  ".join(cells if colour else [letter, *cells]).rstrip(), color=colour)


def _write_table(curves: list[Curve], target: Path, zero_s: float) -> None:
    try:
        with target.open("x", newline="", encoding="utf-8") as stream:
            table = csv.writer(stream)
            table.writerow(["time_s", "curve", "value", "unit"])
            for curve in curves:
                table.writerows(
                    (f"{at - zero_s:.6f}", as_cell(curve.name), repr(value), as_cell(curve.unit))
                    for at, value in curve.points
                )
    except OSError as error:
        raise ConfigError(f"cannot write {target}: {error.strerror}") from None


def _draw_frame(text: str, bitrate: int, data_bitrate: int, out: Path | None) -> None:
    from msbot_agent.explain.frame_picture import frame_lines, frame_picture
    from msbot_agent.link.can.protocol import parse_frame, wire_bits

    try:
        frame = parse_frame(text)
        wire_bits(frame)
    except (ValueError, LocalProtocolError) as error:
        raise ConfigError(f"--frame {text!r}: {error}") from None
    if out is None:
        click.echo("\n".join(frame_lines(frame, shutil.get_terminal_size((100, 30)).columns)))
        return
    if out.suffix.lower() != ".svg":
        raise click.UsageError(f"--out {out}: a frame is drawn as .svg")
    try:
        out.write_text(frame_picture(frame, bitrate=bitrate, data_bitrate=data_bitrate), encoding="utf-8")
    except OSError as error:
        raise ConfigError(f"cannot write {out}: {error.strerror}") from None
    click.echo(f"{out}: {len(wire_bits(frame))} bits")
