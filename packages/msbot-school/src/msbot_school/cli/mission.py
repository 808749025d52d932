"""`msbot mission`: something goes wrong in the robot that runs here; find it, mend it, be graded."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from types import FunctionType
from typing import TYPE_CHECKING

import click

from msbot.cli import completers
from msbot.cli.change.robot_access import perform, say
from msbot.cli.robot_options import mistakes_told, robot_and_json_options, robot_options
from msbot_agent.cli.exit_status import ExitStatus
from msbot_agent.cli.options import WholeRange, json_option
from msbot_agent.cli.table import print_table
from msbot_agent.startup.extensions import extensions
from msbot_xrce.errors import ConfigError

if TYPE_CHECKING:
    from msbot_school.missions.mission import Mission
    from msbot_school.missions.recorded_missions import PlayedMission


@click.group("mission")
def command() -> None:
    """Missions: faults in a running robot that a class finds and repairs.

    When a mission ends (time is over, `stop`, STOP, the robot ends), its faults end.
    """


@command.command("list")
@json_option
def list_missions(*, as_json: bool) -> None:
    """List the missions."""
    from msbot_school.missions.mission_file import ready_missions

    missions = ready_missions().values()
    if as_json:
        click.echo(json.dumps({"missions": [_json(one) for one in missions]}))
        return
    print_table(
        ("mission", "minutes", "robot", "title"),
        [(one.name, f"{one.time_s / 60:g}", one.sample or "any", one.title) for one in missions],
    )


@command.command("check")
@click.argument("file", type=click.Path(path_type=Path))
@json_option
def check(file: Path, *, as_json: bool) -> None:
    """Check a mission file; mistakes are reported with line and remedy (exit status 2)."""
    from msbot_school.missions.mission_file import load_mission

    with mistakes_told(as_json=as_json):
        mission = load_mission(file)
    if as_json:
        click.echo(json.dumps({"problems": [], **_json(mission)}))
        return
    needs = ", ".join(mission.needs) or "none in particular"
    click.echo(
        f"{file} is right: faults: {len(mission.faults)}, things to do: {len(mission.tasks)}, "
        f"{mission.time_s:g} s; slots: {needs}"
    )


@command.command("start")
@click.argument("mission", metavar="NAME|FILE")
@click.option("--seed", type=WholeRange(0, 2**53), metavar="N", help="Seed of the random choices.")
@robot_and_json_options
def start(mission: str, db: str | None, robot: str | None, *, seed: int | None) -> None:
    """Begin a mission, by name or from a FILE.toml."""
    toml = ""
    if mission.endswith(".toml"):
        from msbot_school.missions.mission_file import load_mission

        toml = load_mission(Path(mission)).source
    say(db, robot, "start_mission", {"mission": mission, "toml": toml, "seed": seed})


@command.command("stop")
@robot_and_json_options
def stop(db: str | None, robot: str | None) -> None:
    """End the running mission."""
    say(db, robot, "stop_mission", {})


@command.command("answer")
@click.argument("kind")
@click.argument("at", required=False, default="", metavar="[SLOT]", shell_complete=completers.slots)
@robot_and_json_options
def answer(kind: str, at: str, db: str | None, robot: str | None) -> None:
    """Name the fault: its KIND, and the SLOT unless it concerns the whole robot."""
    say(db, robot, "answer_mission", {"kind": kind, "at": at})


@command.command("repair")
@click.argument("repair")
@click.argument("at", required=False, default="", metavar="[SLOT]", shell_complete=completers.slots)
@robot_and_json_options
def repair(repair: str, at: str, db: str | None, robot: str | None) -> None:
    """Repair something; the right REPAIR at the right place ends the fault."""
    say(db, robot, "repair", {"repair": repair, "at": at})


@command.command("repairs")
@json_option
def repairs(*, as_json: bool) -> None:
    """List the repairs and the faults that they end."""
    from msbot_school.missions.mission import REPAIRS

    if as_json:
        click.echo(
            json.dumps(
                {
                    "repairs": [
                        {"repair": one.name, "words": one.words, "mends": sorted(one.mends), "at_part": one.at_part}
                        for one in REPAIRS.values()
                    ]
                }
            )
        )
        return
    print_table(
        ("repair", "mends", "what it is"),
        [
            (f"{one.name}{' SLOT' if one.at_part else ''}", ", ".join(sorted(one.mends)), one.words)
            for one in REPAIRS.values()
        ],
    )


@command.command("hint")
@robot_and_json_options
def hint(db: str | None, robot: str | None) -> None:
    """Show the next hint; it costs points."""
    say(db, robot, "mission_hint", {})


@command.command("status")
@json_option
@robot_options
def status(db: str | None, robot: str | None, *, as_json: bool) -> None:
    """Show the running mission: story, time left, what is named and repaired."""
    found = perform(db, robot, "mission", {})
    if as_json:
        click.echo(json.dumps(found))
        return
    if "mission" not in found:
        click.echo("No mission runs: `msbot mission list` says what there is.")
        return
    left = found["left_s"]
    assert isinstance(left, int | float)
    click.echo(f"{found['title']} ({found['mission']}), {left:.0f} s left\n{found['story']}")
    click.echo(f"found: {found['found']} of {found['to_find']}; mended: {found['mended']} of {found['to_mend']}")
    for name, mark in (("tasks", "to do"), ("told", "said"), ("hints", "hint")):
        lines = found[name]
        assert isinstance(lines, list)
        for line in lines:
            click.echo(f"{mark}: {_line(line)}")
    click.echo(f"hints left: {found['hints_left']}")


@command.command("report")
@click.option("--number", type=WholeRange(min=1), metavar="N", help="Number of the mission; default: the latest.")
@click.option(
    "--recording", type=click.Path(path_type=Path), metavar="FILE", help="Grade the mission in this recording (.mcap)."
)
@click.option("--html", type=click.Path(path_type=Path), metavar="FILE", help="Write it as a page for printing.")
@click.option("--language", default="en", show_default=True, metavar="CODE", help="Language of that page: en, de.")
@json_option
@robot_options
def report(
    db: str | None,
    robot: str | None,
    *,
    number: int | None,
    recording: Path | None,
    html: Path | None,
    language: str,
    as_json: bool,
) -> None:
    """Show marks, times and wrong acts of a finished mission."""
    played, damage = _played(recording, number) if recording else (_asked(db, robot, number), "")
    if html is not None:
        _write_html(played, html, language)
        click.echo(f"{html} is written", err=as_json)
    if as_json:
        from msbot_school.missions.recorded_missions import grade_json

        click.echo(json.dumps(grade_json(played)))
    elif html is None:
        click.echo("\n".join(_report_lines(played)))
    if damage:
        click.echo(f"msbot: {recording} is damaged: {damage}", err=True)
        sys.exit(ExitStatus.NO)


def _played(recording: Path, number: int | None) -> tuple[PlayedMission, str]:
    """The mission, and what of the recording could not be read."""
    from msbot.recording.recordings.mcap_reader import RecordingReader
    from msbot_school.missions.recorded_missions import played_in

    reader = RecordingReader(recording)
    found = [one for one in played_in(reader) if number in (None, one.number)]
    if not found:
        raise ConfigError(f"there is no mission {number} in {recording}")
    return found[-1], reader.damage


def _asked(db: str | None, robot: str | None, number: int | None) -> PlayedMission:
    from msbot_school.missions.recorded_missions import played_from_json

    return played_from_json(perform(db, robot, "mission_report", {"number": number}))


def _write_html(played: PlayedMission, path: Path, code: str) -> None:
    pages = extensions().all("mission_pages", FunctionType)
    if "html" not in pages:
        raise ConfigError("--html needs the package msbot-web, which is not installed here")
    page = pages["html"](played, code)
    try:
        path.write_text(page, "utf-8")
    except OSError as error:
        raise ConfigError(f"--html: cannot write {path}: {error.strerror}") from None


def _report_lines(played: PlayedMission) -> list[str]:
    found = played.grade()
    lines = [
        f"{played.mission.title} ({played.mission.name}, seed {played.seed}): {found.marks:g} of {found.of:g} marks, "
        f"{found.percent:.0f} %",
        f"over after {found.seconds:.0f} s: {found.reason or 'it was broken off'}",
    ]
    for one in found.faults:
        where = f" at {one.fault.at}" if one.fault.at else ""
        if one.began_s is None:
            lines.append(f"  {one.fault.kind}{where}: never began")
            continue
        named = f"named by {one.found_by} after {one.found_s:.0f} s" if one.found_s is not None else "not named"
        mended = f"mended by {one.mended_by} after {one.mended_s:.0f} s" if one.mended_s is not None else "not mended"
        how = f" ({one.mended_how})" if one.mended_how else ""
        lines.append(f"  {one.fault.kind}{where}: {named}, {mended}{how}: {one.marks:g} of {one.of:g}")
    for task in found.tasks:
        lines.append(f"  {task.task.words} {'done' if task.is_done else 'not done'}: {task.marks:g} of {task.of:g}")
    lines += [f"  {one.at_s:6.0f} s  {one.who}: {one.words}: -{one.cost:g}" for one in found.wrong]
    if found.looked_by:
        lines.append(f"  {found.looked_by} has looked the answers up")
    return [*lines, played.mission.explanation] if played.mission.explanation else lines


def _line(line: object) -> str:
    if not isinstance(line, dict):
        return str(line)
    if "done" in line:
        return f"{line['words']}{' (done)' if line['done'] else ''}"
    return f"{line['at_s']:.0f} s, {line['who']}: {line['text']}"


def _json(mission: Mission) -> dict[str, object]:
    return {
        "mission": mission.name,
        "title": mission.title,
        "story": mission.story,
        "time_s": mission.time_s,
        "robot": mission.sample,
        "slots": list(mission.needs),
        "faults": len(mission.faults),
        "tasks": len(mission.tasks),
        "hints": len(mission.hints),
    }
