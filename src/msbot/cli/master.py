"""`msbot master`: a robot's master on real links."""

from __future__ import annotations

import asyncio
import contextlib
import logging
from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path

import click

from msbot.agent import StatusServer
from msbot.cli.control import MASTER, details_of
from msbot.cli.options import DEFAULT_BLUEPRINT, DEFAULT_LINK, database_beside, db_option
from msbot.cli.page import PageWishes, made_to_stay, page_options, page_wishes, serve_page
from msbot.cli.running import run_until_signal
from msbot.config import Blueprint, Library, load_blueprint, load_library
from msbot.link import CanSettings, Codec, open_link
from msbot.master import Master, profile_of
from msbot.operations import Operations, perform
from msbot.pnp import PartEvent
from msbot.registry import held, open_registry
from msbot.xrce import compress, decompress, is_whole

CAN = CanSettings(codec=Codec(compress, decompress), is_whole=is_whole)


@click.command("master")
@click.argument("blueprint", type=click.Path(path_type=Path), default=DEFAULT_BLUEPRINT)
@click.option("--link", "addresses", multiple=True, default=(DEFAULT_LINK,), show_default=True,
              help="Where parts come in; may be given several times.")  # fmt: skip
@click.option("--library", "folders", multiple=True, type=click.Path(path_type=Path),
              help="A folder with more part types (TOML files); may be given several times.")  # fmt: skip
@db_option
@click.option("-v", "--verbose", is_flag=True, help="Say more.")
@page_options
def command(
    blueprint: Path, addresses: tuple[str, ...], folders: tuple[Path, ...], db: str | None, *, verbose: bool,
    port: int | None, host: str, no_page: bool, certificate: Path | None, certificate_key: Path | None,
) -> None:  # fmt: skip
    """Run the master of the robot that BLUEPRINT (robot.toml) describes, until Ctrl-C.

    Its page is at the address that is printed; at the first start a link that makes you its administrator.
    """
    page = page_wishes(port=port, host=host, no_page=no_page, certificate=certificate, certificate_key=certificate_key)
    logging.basicConfig(
        level=logging.INFO if verbose else logging.WARNING, format="%(asctime)s %(message)s", datefmt="%H:%M:%S"
    )
    library = load_library(*folders)
    robot = load_blueprint(blueprint, library)
    for address in addresses:
        open_link(address, serve=True, can=CAN)  # what is wrong is told before the database is touched
    with contextlib.suppress(KeyboardInterrupt):
        asyncio.run(_main(robot, library, addresses, db or database_beside(blueprint), page))


async def _main(blueprint: Blueprint, library: Library, addresses: Sequence[str], db: str, page: PageWishes) -> None:
    profile = profile_of(blueprint)
    kept = held.bring_back_held(db)
    if kept is not None:
        click.echo(f"the backup that was handed in is in force; what the database had is kept in {kept}")
    with open_registry(db) as registry:
        robot = registry.apply_blueprint(blueprint, library)
        master = Master(blueprint, registry.store_for(robot))
        operations = Operations(master, registry, robot, library=library)
        master.inventory.on_event(_say)
        can = replace(CAN, profile_hash=profile.profile_hash(), node_ids=partial(registry.node_ids, robot))
        links = [open_link(address, serve=True, can=can) for address in addresses]
        for link in links:
            master.add_link(link)
        where = ", ".join(link.info.name for link in links)

        def greet() -> None:
            click.echo(
                f"{profile.name} {profile.version} is up on {where}; database {registry.database}. Ctrl-C ends it."
            )

        page_beside = []
        if not page.off:
            with made_to_stay():
                from msbot.web.compose import Database, WebRoom
                from msbot.web.real_buses import seen_of_links

                database = Database(registry, robot, db)
                room = WebRoom(
                    master, operations, library, database=database, seen=seen_of_links(links), settings=page.settings()
                )
            page_beside.append(serve_page(room, master.ready, page, click.echo))
        status = StatusServer(
            master.agent,
            what=MASTER,
            name=f"{profile.name} {profile.version}",
            details=lambda: details_of(profile.name, db, registry.trouble),
            control=partial(perform, operations),
        )
        await run_until_signal(master.run(), beside=[status.run(), *page_beside], ready=master.ready, say=greet)


def _say(event: PartEvent) -> None:
    click.echo(event.sentences()[0])
