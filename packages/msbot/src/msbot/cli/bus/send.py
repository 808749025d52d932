"""Puts frames on a live bus: `msbot bus send`."""

from __future__ import annotations

import asyncio
import contextlib
import logging
from collections.abc import Callable, Sequence
from typing import Final

import click

from msbot.cli.bus.bus_source import Listening, open_bus
from msbot_agent.cli.until_ended import run_until_signal
from msbot_agent.link.can import BusState
from msbot_agent.link.can.protocol import Frame, check_frame, format_frame, parse_frame
from msbot_agent.link.can.sim import SimBus, SimBusDriver, SimBusServer, rates_words
from msbot_agent.log import TerminalHandler
from msbot_agent.process.end_signals import run_to_end
from msbot_agent.process.nonblocking_output import nonblocking_output
from msbot_xrce.counting import amount
from msbot_xrce.errors import ConfigError, LinkDown, LocalProtocolError

PATIENCE_S: Final = 2.0
"""A frame that has not left the controller after this time was not acknowledged."""
LOOK_S: Final = 0.001


def send(address: str, texts: Sequence[str], repeat: int, period_s: float, complain: Callable[[str], None]) -> None:
    """Send frames `repeat` times, and wait until the last has left.

    Args:
        address: the bus.
        texts: frames in the notation of can-utils.
        repeat: how often all of them are sent.
        period_s: seconds from one time to the next.
        complain: takes what goes wrong on the bus.

    Raises:
        ConfigError: there is no such bus, or it cannot carry one of the frames.
        LinkDown: the bus cannot be opened, or nobody acknowledges.
    """
    frames = [parse_frame(text) for text in texts]
    run_to_end(_open_and_send(address, frames, repeat, period_s, complain))


async def _open_and_send(
    address: str, frames: Sequence[Frame], repeat: int, period_s: float, complain: Callable[[str], None]
) -> None:
    bus = open_bus(address, node="send")
    for frame in frames:
        try:
            check_frame(frame)
        except LocalProtocolError as error:
            raise ConfigError(f"{format_frame(frame)}: {error}") from None
        if frame.fd and not bus.info.fd:
            raise ConfigError(f"{format_frame(frame)} is a CAN FD frame, and {bus.info.name} is classic CAN: add ?fd=1")
    listening = Listening(bus, complain)
    await listening.run_with(_send(listening, frames, repeat, period_s))


async def _send(listening: Listening, frames: Sequence[Frame], repeat: int, period_s: float) -> None:
    loop, bus = asyncio.get_running_loop(), listening.bus
    await listening.opened.wait()
    for number in range(repeat):
        next_at = loop.time() + period_s
        for frame in frames:
            await _wait(listening, bus.has_room, frame)
            bus.send(frame)
        if number < repeat - 1:
            await asyncio.sleep(max(0.0, next_at - loop.time()))
    await _wait(listening, lambda: not bus.pending(), frames[-1])


async def _wait(listening: Listening, done: Callable[[], bool], frame: Frame) -> None:
    name = listening.bus.info.name
    give_up_at = asyncio.get_running_loop().time() + PATIENCE_S
    while not done():
        if listening.state is BusState.OFF:
            raise LinkDown(f"{format_frame(frame)} was not sent: the controller of {name} is bus-off")
        if asyncio.get_running_loop().time() > give_up_at:
            raise LinkDown(
                f"{format_frame(frame)} did not leave the controller within {PATIENCE_S:g} s: nobody on {name} "
                "acknowledges. Is another node on the bus, with the same bit rate?"
            )
        await asyncio.sleep(LOOK_S)


# Serves a simulated bus that other programs join by its name: `msbot bus serve`.


def serve(name: str, bitrate: int, data_bitrate: int | None) -> None:
    """Serve a bus until Ctrl-C; with a data bit rate it is CAN FD.

    Raises:
        ConfigError: it is not a name.
        LinkDown: another process serves a bus of that name.
    """
    logging.basicConfig(level=logging.WARNING, handlers=[TerminalHandler()])
    with contextlib.suppress(KeyboardInterrupt), nonblocking_output():
        run_to_end(_serve(name, bitrate, data_bitrate))


async def _serve(name: str, bitrate: int, data_bitrate: int | None) -> None:
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
