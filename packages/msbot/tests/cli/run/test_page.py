"""The page's options on the command line, and what is said when it is served."""

from __future__ import annotations

import asyncio
from pathlib import Path
from typing import TYPE_CHECKING, cast

import click
import pytest
from click.testing import CliRunner, Result

from msbot.process.virtual_time import run_virtual
from msbot_web.access.accounts import Accounts
from msbot_web.access.users import MemoryUsers
from msbot_web.cli.page import DEFAULT_PORT, PageOptions, page_options, page_wishes, serve_page
from msbot_web.server import WebSettings
from msbot_xrce.errors import ConfigError

if TYPE_CHECKING:
    from msbot_web.assembly import RobotPages

LINK = "http://127.0.0.1:8080/setup?token=x"


def wishes(*, host: str = "127.0.0.1", certificate: Path | None = None) -> PageOptions:
    return page_wishes(port=None, host=host, no_page=False, certificate=certificate, certificate_key=None)


def ask(*arguments: str) -> Result:
    """Run a command that has the page's options and nothing else."""
    found: list[PageOptions] = []

    @click.command()
    @page_options
    def command(
        *,
        port: int | None,
        host: str,
        no_page: bool,
        certificate: Path | None,
        certificate_key: Path | None,
        page_names: tuple[str, ...],
        trusted_proxies: tuple[str, ...],
    ) -> None:
        found.append(
            page_wishes(
                port=port,
                host=host,
                no_page=no_page,
                certificate=certificate,
                certificate_key=certificate_key,
                page_names=page_names,
                trusted_proxies=trusted_proxies,
            )
        )
        click.echo(repr(found[0]))

    return CliRunner().invoke(command, arguments)


def test_without_options_this_computer_only_and_the_usual_port_or_another() -> None:
    assert wishes().settings() == WebSettings("127.0.0.1", DEFAULT_PORT, or_any_port=True)
    assert "off=False" in ask().output


def test_a_port_that_was_asked_for_is_that_one_or_none() -> None:
    asked = page_wishes(port=9000, host="127.0.0.1", no_page=False, certificate=None, certificate_key=None)
    assert asked.settings() == WebSettings("127.0.0.1", 9000, or_any_port=False)


def test_a_key_alone_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="--certificate-key needs the certificate, too: --certificate FILE"):
        page_wishes(port=None, host="127.0.0.1", no_page=False, certificate=None, certificate_key=tmp_path)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--port", "70000"], "'70000' is not a whole number from 0 to 65535"),
        (["--port", "web"], "'web' is not a whole number from 0 to 65535"),
        (["--certificate", "nowhere.pem"], "does not exist"),
    ],
)
def test_what_makes_no_sense_is_told_at_once(arguments: list[str], words: str) -> None:
    done = ask(*arguments)
    assert done.exit_code == 2
    assert words in done.output


def test_the_page_can_be_left_out() -> None:
    assert "off=True" in ask("--no-page").output


class Served:
    """A page that is up after a second and serves until cancelled."""

    link = LINK

    def __init__(self) -> None:
        self.server = self
        self.ready = asyncio.Event()
        self.has_ended = False

    async def run(self) -> None:
        try:
            await asyncio.sleep(1.0)
            self.ready.set()
            await asyncio.Event().wait()
        finally:
            self.has_ended = True


def said(asked: PageOptions, robot_after_s: float, until_s: float) -> list[tuple[float, str]]:
    """What is said, and when."""
    lines: list[tuple[float, str]] = []

    async def main() -> None:
        loop, room, ready = asyncio.get_running_loop(), Served(), asyncio.Event()
        begin = loop.time()
        loop.call_later(robot_after_s, ready.set)
        serving = asyncio.ensure_future(
            serve_page(cast("RobotPages", room), ready, asked, lambda line: lines.append((loop.time() - begin, line)))
        )
        await asyncio.sleep(until_s)
        serving.cancel()
        await asyncio.wait([serving])
        assert serving.cancelled()
        assert room.has_ended

    run_virtual(main())
    return lines


def test_the_address_is_said_when_page_and_robot_are_up() -> None:
    assert said(wishes(), 3.0, 5.0) == [(3.0, f"The page is at {LINK}")]
    assert said(wishes(), 0.1, 5.0) == [(1.0, f"The page is at {LINK}")]
    assert said(wishes(), 3.0, 2.0) == []


@pytest.mark.parametrize("host", ["127.0.0.1", "192.168.100.100"])
def test_the_line_with_the_link_fits_a_terminal_of_80_columns(host: str) -> None:
    accounts = Accounts(MemoryUsers(), clock=lambda: 0.0)
    for path, word in (("setup", accounts.setup_token()), ("enter", accounts.entry_token())):
        assert len(f"The page is at https://{host}:8080/{path}?token={word}") <= 80


def test_who_can_reach_it_is_said_when_it_is_not_this_computer_only(tmp_path: Path) -> None:
    (_, (_, plain)) = said(wishes(host="0.0.0.0"), 0.0, 5.0)
    assert plain.startswith("Everybody in this computer's networks can reach it")
    assert plain.endswith("what travels can be read: add --certificate.")
    (_, (_, safe)) = said(wishes(host="0.0.0.0", certificate=tmp_path), 0.0, 5.0)
    assert safe == "Everybody in this computer's networks can reach it; a password protects it."
    assert len(said(wishes(host="::1"), 0.0, 5.0)) == 1
