"""`run`: from a student's program to a part on a link, with a clean end on Ctrl-C.

A mistake that the user can fix is one sentence on stderr and exit status 2, never a traceback.
"""

from __future__ import annotations

import argparse
import asyncio
import contextlib
import logging
import os
import sys
from dataclasses import replace
from typing import TYPE_CHECKING

from msbot.part.beginner_hints import HandlerWatch, part_is_run
from msbot.part.imported_program import is_imported_by_test
from msbot.part.join.part_keys import KEY_VARIABLE, given_key, is_key_file
from msbot.part.join.uid import parse_uid, stored_uid
from msbot_agent.link import Link, open_link
from msbot_agent.link.can import CanSettings, Codec
from msbot_agent.log import TerminalHandler
from msbot_agent.process.end_signals import on_end_signal, run_to_end, ungrouped
from msbot_xrce import compress, decompress, is_whole
from msbot_xrce.errors import ConfigError, MsbotError

if TYPE_CHECKING:
    from collections.abc import Sequence

    from msbot.part.part import Part

_log = logging.getLogger(__name__)

DEFAULT_LINK = "udp:127.0.0.1:8888"
LINK_VARIABLE = "MSBOT_LINK"
CAN = CanSettings(codec=Codec(compress, decompress), is_whole=is_whole)


def run(*parts: Part, args: list[str] | None = None) -> None:
    """Run one or more parts until Ctrl-C or SIGTERM; each has its own session and closes it at the end.

    Options: `--link ADDRESS` (or $MSBOT_LINK, or this computer), `--uid HEX` and
    `--key FILE` (one part only), `--quiet`. Does nothing in a program that a test imports.

    Args:
        parts: what to run.
        args: the command line without the program's name; `sys.argv[1:]` if absent.

    Raises:
        SystemExit: status 2 after one sentence on stderr, when something is wrong that the user can fix.
    """
    if is_imported_by_test():
        for part in parts:
            part_is_run(part)
        return
    try:
        if isinstance(args, str):
            raise ConfigError(f'run() takes a list, as a command line is one: run(["--link", {args!r}])')
        options = _parse(args)
        run_parts(
            parts, link=options.link, uid=options.uid, key=options.key, quiet=options.quiet, verbose=options.verbose
        )
    except MsbotError as error:
        sys.stderr.write(f"{' '.join(str(error).split())}\n")
        raise SystemExit(2) from None


def run_parts(
    parts: Sequence[Part], *, link: str | None, uid: str | None, key: str | None, quiet: bool, verbose: bool = False
) -> None:
    """What `run` does once the options are read.

    Args:
        parts: what to run.
        link: the way to the master; None: $MSBOT_LINK, or this computer.
        uid: that of the one part; None: the one kept on this computer.
        key: that of the one part, or the file with it; None: $MSBOT_KEY, or the one kept on this computer.
        quiet: say only what is wrong.
        verbose: say more.

    Raises:
        MsbotError: something is wrong that the user can fix.
    """
    logging.basicConfig(level=logging.WARNING if quiet else logging.INFO, handlers=[TerminalHandler()])
    if verbose:
        logging.getLogger("msbot.part").setLevel(logging.DEBUG)
    for part in parts:
        part_is_run(part)
    _give_uids(parts, uid)
    _give_keys(parts, key)
    links = [_open(link, part) for part in parts]
    with contextlib.suppress(KeyboardInterrupt):
        run_to_end(_run_all(list(zip(parts, links, strict=True))))


def _open(link: str | None, part: Part) -> Link:
    can = replace(CAN, uid=part.uid)
    return linked_by_environment(can) if link is None else open_link(link, can=can)


def linked_by_environment(can: CanSettings) -> Link:
    """The link that $MSBOT_LINK names; this computer when it names none.

    Raises:
        ConfigError: the address makes no sense.
    """
    address = os.environ.get(LINK_VARIABLE)
    if not address:
        return open_link(DEFAULT_LINK, can=can)
    try:
        return open_link(address, can=can)
    except ConfigError as error:
        raise ConfigError(f"${LINK_VARIABLE}: {error}") from None


def _give_uids(parts: Sequence[Part], uid: str | None) -> None:
    if not parts:
        raise ConfigError("run() needs a part: run(part)")
    if uid is not None and len(parts) > 1:
        raise ConfigError(f"--uid is for a program with one part, this one has {len(parts)}")
    for part in parts:
        if uid is not None:
            part.uid = parse_uid(uid)
        elif part.uid is None:
            part.uid = stored_uid(part.part_number, part.local_name)


def _give_keys(parts: Sequence[Part], key: str | None) -> None:
    if key is not None and len(parts) > 1:
        raise ConfigError(f"--key is for a program with one part, this one has {len(parts)}")
    for part in parts:
        if key is not None or part.key is None:
            part.key = given_key(key, part.part_number, part.local_name)
    if key is not None and not is_key_file(key):
        _log.warning(
            "every user of this computer can read the key in --key (`ps`): write it into a file (chmod 600) and give "
            "its name, or set $%s",
            KEY_VARIABLE,
        )


async def _run_all(pairs: list[tuple[Part, Link]]) -> None:
    end_on_signals([part for part, _ in pairs])
    watch = HandlerWatch(lambda: next((part.busy_with for part, _ in pairs if part.busy_with is not None), None))
    try:
        with ungrouped(MsbotError):
            async with asyncio.TaskGroup() as group:
                for part, link in pairs:
                    group.create_task(part.run_async(link))
    finally:
        watch.end()


def end_on_signals(parts: list[Part]) -> None:
    """Have SIGINT, SIGTERM and SIGHUP end the parts cleanly; where the loop cannot do that, Ctrl-C just ends them.

    A handler that never returns is broken off: nobody shall have to kill a program for its first mistake.
    """

    def end() -> None:
        for part in parts:
            part.end()

    on_end_signal(end, even_if_stuck=True)


def _parse(args: list[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(description="A part of a MsBOT robot.")
    default = os.environ.get(LINK_VARIABLE) or DEFAULT_LINK
    parser.add_argument("--link", help=f"the way to the master (now {default}; ${LINK_VARIABLE})")
    parser.add_argument("--uid", help="16 hexadecimal digits that identify the piece of hardware")
    parser.add_argument("--key", help=f"file with the part's key, or the key itself (${KEY_VARIABLE})")
    parser.add_argument("-v", "--verbose", action="store_true", help="show the whole traceback of an error, and more")
    parser.add_argument("--quiet", action="store_true", help="say only what is wrong")
    return parser.parse_args(args)
