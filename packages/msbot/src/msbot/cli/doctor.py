"""`msbot doctor`: what keeps a robot from working, and what mends it."""

from __future__ import annotations

import json
import logging
import sys
from pathlib import Path
from typing import TYPE_CHECKING
from urllib.parse import urlsplit

import click

from msbot.cli.database_place import DEFAULT_BLUEPRINT, database_here, is_there, no_database
from msbot.cli.robot_options import robot_options
from msbot_agent.cli.exit_status import ExitStatus
from msbot_agent.cli.options import json_option, space_option
from msbot_agent.link import open_link
from msbot_agent.log import TerminalHandler
from msbot_agent.space import SpaceAddress
from msbot_xrce import is_whole
from msbot_xrce.errors import ConfigError

if TYPE_CHECKING:
    from msbot.doctor import Examination, Examined


@click.command("doctor")
@click.option(
    "--link",
    "addresses",
    multiple=True,
    help="A link that the robot will use, as for `msbot master`; repeatable.",
)
@robot_options
@space_option
@click.option("--only", metavar="CHECK,...", help="Only these checks, for example can,robot.")
@click.option("-v", "--verbose", is_flag=True, help="Also list what is in order.")
@click.option(
    "--report",
    "file",
    type=click.Path(path_type=Path, dir_okay=False),
    metavar="FILE",
    help="Write what was seen into FILE, without secrets, for people who help.",
)
@json_option
def command(
    addresses: tuple[str, ...],
    db: str | None,
    robot: str | None,
    space: SpaceAddress,
    only: str | None,
    *,
    verbose: bool,
    as_json: bool,
    file: Path | None,
) -> None:
    """Find what keeps a robot from working: installation, buses, network, database, the robot itself.

    Reports problems only, with why they matter and how to mend them; status 1 if there is something to mend. It
    finds a master that runs here by itself.
    """
    from msbot.doctor import examine
    from msbot_agent.link.can import CanSettings

    logging.basicConfig(level=logging.WARNING, handlers=[TerminalHandler("%(message)s")])
    for address in addresses:
        open_link(address, serve=True, can=CanSettings(is_whole=is_whole))  # a mistake is said at once
    if db is not None and not is_there(db):  # one that is not named may be missing: the robot is new
        raise ConfigError(no_database(db))
    names = [name.strip() for name in only.split(",")] if only else []
    patient = _patient(addresses, db, robot, space)
    found = examine(patient, names)
    if file is not None:
        _write_report(file, patient, found)
    if as_json:
        click.echo(json.dumps(found.as_json(), ensure_ascii=False))
    else:
        for line in lines(found, verbose=verbose):
            click.echo(line)
    sys.exit(ExitStatus.DONE if found.is_well else ExitStatus.NO)


def _write_report(file: Path, patient: Examined, found: Examination) -> None:
    from msbot.doctor.report import report

    place = [
        Path.cwd(),
        *([Path(patient.database).parent] if patient.database and "://" not in patient.database else []),
    ]
    file.write_text(report(patient, found, place), "utf-8")
    click.echo(
        f"{file} is written, without secrets and names of people. Read it before you show it to others.", err=True
    )


def _patient(addresses: tuple[str, ...], db: str | None, robot: str | None, space: SpaceAddress) -> Examined:
    from msbot.doctor import Examined
    from msbot.doctor.finding import PAGE_PORT
    from msbot_agent.agent import read_statuses

    masters = tuple(read_statuses())
    database = db or database_here()
    links = addresses
    is_known = is_there(database)
    meant = [one for one in masters if one.details and robot in (None, one.details.get("robot"))]
    if db is None and not is_known and len(meant) == 1:
        database, is_known = meant[0].details["database"], True
    if not links:
        links = tuple(link.name for one in meant for link in one.links)
    return Examined(
        database=database if is_known or db else None,
        robot=robot,
        blueprint=DEFAULT_BLUEPRINT if DEFAULT_BLUEPRINT.exists() else None,
        links=links,
        space=space,
        masters=masters,
        page_port=next((port for one in meant if (port := urlsplit(one.details.get("page", "")).port)), PAGE_PORT),
    )


def lines(found: Examination, *, verbose: bool) -> list[str]:
    """What is printed."""
    said: list[str] = []
    for check, finding in found.findings:
        note = "" if finding.must else "(note) "
        where = finding.about if finding.about == check else f"{finding.about} ({check})"
        said.append(f"{note}{where}: {finding.saw}")
        rows = (("why", finding.why), ("wire", finding.wire), ("first", finding.first), ("mend", finding.mend))
        said += [f"    {title.ljust(6)} {text}" for title, text in rows if text]
    if verbose:
        said += [f"in order: {check}" for check in found.well]
        said += [f"not needed: {check}: {why}" for check, why in found.not_needed]
    said += [f"not looked at: {check}: {why}" for check, why in found.not_seen]
    if found.is_well:
        said.append("Nothing to mend in what was looked at." if found.not_seen else "Nothing to mend.")
    return said
