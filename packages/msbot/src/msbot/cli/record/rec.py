"""`msbot rec`: keep what the flight recorder has, and record in files."""

from __future__ import annotations

import json
import time
from collections.abc import Iterator
from dataclasses import asdict
from datetime import datetime
from pathlib import Path
from typing import Any

import click

from msbot.cli.change.robot_access import perform, running_master
from msbot.cli.database_place import database_here, is_there, no_database
from msbot.cli.record.log import recording_name
from msbot.cli.robot_options import robot_options
from msbot.cli.run.ring_folders import find_ring_folders
from msbot.registry.records import database_identity
from msbot_agent.cli.options import FiniteRange, json_option
from msbot_agent.cli.table import print_table
from msbot_agent.text.sentence import printable
from msbot_xrce.counting import amount
from msbot_xrce.errors import ConfigError
from msbot_xrce.lazy import dataclass

JUST_NOW_S = 0.8
"""What a robot has said is in the ring's file after at most this time."""
BEGIN_S = 10.0
"""How long a recorder that is behind may take to begin a file."""


@click.group("rec")
def command() -> None:
    """The flight recorder of the robot that runs here: save what it has, or record to a file."""


_ros2_option = click.option("--ros2", "ros", is_flag=True, help="As a bag: only what ROS 2 can read, for `ros2 bag`.")


@command.command("save")
@click.argument("file", type=click.Path(path_type=Path))
@click.option("--last", "last_s", type=FiniteRange(min=0.1), metavar="SECONDS", help="Only the last SECONDS.")
@_ros2_option
@robot_options
def save(file: Path, last_s: float | None, db: str | None, robot: str | None, *, ros: bool) -> None:
    """Save the last minutes of the flight recorder in FILE (.mcap), also of a robot that has ended."""
    from msbot.recording.recorder.recording_file import begun_segments
    from msbot.recording.recordings.excerpts import write_cut
    from msbot.recording.recordings.mcap_reader import ended_ns
    from msbot.recording.recordings.summary import named_topics

    target = recording_name(file)
    trouble = ""
    if running_master(db, robot) is None:
        folder = _ring_left(db, robot)
    else:
        status = _status(db, robot)
        folder = str(status.get("folder") or "")
        troubles = status.get("troubles")
        trouble = str(troubles.get(folder, "")) if isinstance(troubles, dict) else ""
        if not folder:
            raise ConfigError("this robot runs with `--rec off`: nothing was recorded")
        time.sleep(JUST_NOW_S)  # until the last moment is in the file
    try:
        found = begun_segments(Path(folder))
    except OSError as error:
        raise ConfigError(f"cannot read the recorder's folder {folder}: {error.strerror}") from None
    if not found:
        raise ConfigError(f"the recorder has nothing in {folder}: {trouble or 'nothing is written yet'}")
    paths = [segment.path for segment in found]
    from_ns = None if last_s is None else ended_ns(paths) - round(last_s * 1e9)
    cut = write_cut(paths, target, from_ns=from_ns, ros=ros)
    seconds = 0.0 if cut.first_ns is None or cut.last_ns is None else (cut.last_ns - cut.first_ns) / 1e9
    click.echo(f"{target}: {amount(cut.messages, 'message')} of {seconds:.0f} s")
    if cut.left_out:
        click.echo(f"left out, for they are no ROS 2 messages: {named_topics(cut.left_out)}")
    for name, damage in cut.damages.items():
        if name != paths[-1].name:  # the newest file is being written: it has no end yet
            click.echo(f"msbot: {name} is damaged: {damage}", err=True)  # what is kept is all that there is


@command.command("start")
@click.argument("file", type=click.Path(path_type=Path))
@_ros2_option
@robot_options
def start(file: Path, db: str | None, robot: str | None, *, ros: bool) -> None:
    """Record in FILE from now on, in addition to the ring."""
    path = recording_name(file).absolute()
    words = str(perform(db, robot, "record", {"file": str(path), "ros2": ros})["words"])
    _wait_until_begun(path, db, robot)
    click.echo(printable(words))


@command.command("stop")
@robot_options
def stop(db: str | None, robot: str | None) -> None:
    """End the recording that `rec start` or `--rec FILE` began."""
    click.echo(printable(str(perform(db, robot, "end_record", {})["words"])))


@command.command("list")
@json_option
@robot_options
def list_recordings(db: str | None, robot: str | None, *, as_json: bool) -> None:
    """Show where the robot is recorded, how much, and what is wrong.

    Without a master: the rings of robots that have ended.
    """
    if running_master(db, robot) is None:
        _list_left(db, robot, as_json=as_json)
        return
    status = _status(db, robot)
    files = [asdict(one) for one in _files(str(status.get("folder") or ""))]
    if as_json:
        click.echo(json.dumps({**status, "files": files}))
        return
    if not status:
        click.echo("This robot runs with `--rec off`: nothing is recorded.")
        return
    _show_ring(str(status["folder"]), files)
    if status.get("file"):
        what = "What ROS 2 can read" if status.get("ros2") else "Everything"
        click.echo(f"{what} is recorded in {status['file']}, too.")
    if topics := status.get("not_ros2"):
        click.echo(f"Left out there, for they are no ROS 2 messages: {_names(topics)}")
    if left_out := status.get("left_out"):
        click.echo(f"{left_out} bytes were left out: more was said than could be written.")
    troubles = status.get("troubles")
    for name, trouble in (troubles if isinstance(troubles, dict) else {}).items():
        click.echo(f"{name} {trouble}")


@dataclass(frozen=True, slots=True)
class _File:
    name: str
    octets: int
    changed: str


def _files(folder: str) -> Iterator[_File]:
    from msbot.recording.recorder.recording_file import segments

    if folder and Path(folder).is_dir():
        for segment in segments(Path(folder)):
            changed = datetime.fromtimestamp(segment.changed_s).isoformat(" ", "seconds")
            yield _File(segment.path.name, segment.octets, changed)


def _names(topics: object) -> str:
    return printable(", ".join(sorted(topics))) if isinstance(topics, set | list) else ""


def _wait_until_begun(path: Path, db: str | None, robot: str | None) -> None:
    """Wait until the recorder has the file.

    Raises:
        ConfigError: it cannot write it, or has not begun it in time.
    """
    end = time.monotonic() + BEGIN_S
    while not path.exists():
        status = _status(db, robot)
        troubles = status.get("troubles")
        trouble = troubles.get(str(path)) if isinstance(troubles, dict) else None
        if trouble:
            raise ConfigError(f"{path} {trouble}: nothing is recorded there; name a file in another folder")
        if time.monotonic() > end:
            raise ConfigError(f"the recorder has not begun {path} within {BEGIN_S:.0f} s: see `msbot rec list`")
        time.sleep(JUST_NOW_S / 8)


def _show_ring(folder: str, files: list[dict[str, Any]]) -> None:
    octets = sum(one["octets"] for one in files)
    click.echo(f"The ring is in {folder}: {amount(len(files), 'file')}, {octets / 1e6:.1f} MB.")
    if files:
        print_table(
            ("file", "MB", "written"),
            [(one["name"], f"{one['octets'] / 1e6:.2f}", one["changed"]) for one in files],
        )


def _list_left(db: str | None, robot: str | None, *, as_json: bool) -> None:
    if db is not None and not is_there(db) and not _left(db, robot):
        raise ConfigError(f"no master runs here, and {no_database(db)}")
    left = {str(folder): [asdict(one) for one in _files(str(folder))] for folder in _left(db, robot)}
    if as_json:
        click.echo(json.dumps({"left": [{"folder": folder, "files": files} for folder, files in left.items()]}))
        return
    click.echo("No master runs here; " + ("this is left of earlier ones:" if left else "nothing is recorded."))
    for folder, files in left.items():
        _show_ring(folder, files)


def _ring_left(db: str | None, robot: str | None) -> str:
    """The ring of the one robot that is meant, and does not run."""
    found = _left(db, robot)
    if not found:
        if db is not None and not is_there(db):
            raise ConfigError(f"no master runs here, and {no_database(db)}")
        raise ConfigError("no master runs here, and no recorder has left a ring of such a robot")
    if len(found) > 1:
        names = ", ".join(folder.name for folder in found)
        raise ConfigError(
            f"no master runs here, and {len(found)} robots have left a ring: say which one is meant with --robot "
            f"or --db: {names}"
        )
    return str(found[0])


def _left(db: str | None, robot: str | None) -> list[Path]:
    path = db or database_here()
    is_named = db is not None or is_there(path)
    return find_ring_folders(robot, database_identity(path) if is_named else None)


def _status(db: str | None, robot: str | None) -> dict[str, object]:
    return perform(db, robot, "recording", {})
