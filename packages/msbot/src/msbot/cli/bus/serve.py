"""Serves a simulated bus that other programs join by its name: `msbot bus serve`."""

from __future__ import annotations

import contextlib
import logging

import click

from msbot_agent.cli.until_ended import run_until_signal
from msbot_agent.link.can.sim import SimBus, SimBusDriver, SimBusServer, rates_words
from msbot_agent.log.terminal_log import TerminalHandler
from msbot_agent.process.event_loop import run_to_end
from msbot_agent.process.patient_output import patient_output
from msbot_xrce.common.amount import amount


def serve(name: str, bitrate: int, data_bitrate: int | None) -> None:
    """Serve a bus until Ctrl-C; with a data bit rate it is CAN FD.

    Raises:
        ConfigError: it is not a name.
        LinkDown: another process serves a bus of that name.
    """
    logging.basicConfig(level=logging.WARNING, handlers=[TerminalHandler()])
    with contextlib.suppress(KeyboardInterrupt), patient_output():
        run_to_end(_main(name, bitrate, data_bitrate))


async def _main(name: str, bitrate: int, data_bitrate: int | None) -> None:
    fd = data_bitrate is not None
    server = SimBusServer(SimBusDriver(SimBus(bitrate, data_bitrate, fd=fd)), name)

    def greet() -> None:
        click.echo(
            f"simulated bus {name} ({rates_words(bitrate, data_bitrate, fd=fd)}) is up: --link sim:{name}, "
            f"msbot bus dump sim:{name}, python -m can.logger -i msbot -c {name}; Ctrl-C ends it"
        )

    await run_until_signal(server.run(), ready=server.ready, say=greet)
    counters = server.driver.counters
    click.echo(f"{amount(counters.frames, 'frame')}, {amount(counters.errors, 'attempt')} failed")
