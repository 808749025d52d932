"""Where `msbot bus dump`, `send` and `load` get their bus from: a live one by its address, or a log of one."""

from __future__ import annotations

import asyncio
import time
from collections.abc import Callable, Coroutine, Hashable, Mapping
from dataclasses import field
from pathlib import Path
from typing import Any

from msbot.cli.bus.frame_log import FOREIGN_FORMATS, OWN_FORMAT
from msbot.cli.robot_options import user_name
from msbot.config import MessageType, type_from_words
from msbot.pnp import KnownObject
from msbot_agent.agent import MASTER, RunningProcess, running_processes
from msbot_agent.link.can import BusState, open_can_bus
from msbot_agent.link.can.adapters import CanDriver
from msbot_agent.link.can.protocol import Frame
from msbot_agent.link.can.sim import open_sim_bus
from msbot_agent.process.end_signals import on_end_signal
from msbot_xrce.counting import amount
from msbot_xrce.errors import ConfigError
from msbot_xrce.lazy import dataclass

SCHEMES = ("can", "sim")


def is_log(name: str) -> bool:
    """Whether a name means a log (or standard input) and not a bus."""
    return name == "-" or Path(name).suffix.lower() in (OWN_FORMAT, *FOREIGN_FORMATS) or Path(name).is_file()


def is_bus(name: str) -> bool:
    """Whether a name means a bus and not a file."""
    scheme, colon, _ = name.partition(":")
    return bool(colon and scheme.lower() in SCHEMES) or not (Path(name).exists() or Path(name).suffix)


def open_bus(address: str, *, node: str, listen_only: bool = False) -> CanDriver:
    """The controller of an address: `can0`, `can:can0`, `can:slcan:/dev/ttyACM0?bitrate=500000`, `sim:classroom`.

    Args:
        address: the bus.
        node: what the controller is called on a simulated bus.
        listen_only: neither send nor acknowledge, where that can be chosen.

    Raises:
        ConfigError: the address makes no sense.
    """
    scheme, colon, rest = address.strip().partition(":")
    if not colon and not Path(address).suffix:
        return open_can_bus(f"can:{address}", error_frames=True)
    match scheme.lower():
        case "can":
            return open_can_bus(address, error_frames=True)
        case "sim":
            return open_sim_bus(rest, node=node, listen_only=listen_only)
    raise ConfigError(
        f"{address!r} is neither a CAN bus nor a log that is there: buses are written like `can0`, "
        "`can:slcan:/dev/ttyACM0?bitrate=500000` and `sim:classroom`, "
        f"logs end in {', '.join((OWN_FORMAT, *FOREIGN_FORMATS))}"
    )


class Listening:
    """Runs a controller until Ctrl-C, SIGTERM, or `finish`, and converts times to seconds since 1970."""

    def __init__(self, bus: CanDriver, complain: Callable[[str], None]) -> None:
        """Prepare; `complain` gets what goes wrong on the bus."""
        self.bus = bus
        self.opened = asyncio.Event()
        """The bus is open."""
        self.state = BusState.GONE
        """State of the controller."""
        self._ended = asyncio.Event()
        self._complain = complain
        self._epoch_s = 0.0
        self._failure: Exception | None = None
        bus.attach(state=self._state)

    def on_frame(self, handler: Callable[[Frame, float], None]) -> None:
        """Set the handler for frames; the times are seconds since 1970. An exception in the handler ends `run`, which
        raises it."""

        def heard(frame: Frame, now: float) -> None:
            if self._failure is not None:
                return
            try:
                handler(frame, now + self._epoch_s)
            except Exception as error:  # from the handler, not the bus: the controller must not be affected
                self._failure = error
                self.finish()

        self.bus.attach(frame=heard)

    def finish(self) -> None:
        """End `run`."""
        self._ended.set()

    async def run(self) -> None:
        """Listen.

        Raises:
            LinkDown: the bus cannot be opened; the text names the remedy.
        """
        loop = asyncio.get_running_loop()
        self._epoch_s = time.time() - loop.time()
        on_end_signal(self.finish)
        listening = loop.create_task(self.bus.run())
        ended = loop.create_task(self._ended.wait())
        try:
            await asyncio.wait((listening, ended), return_when=asyncio.FIRST_COMPLETED)
            if listening.done():
                listening.result()
        finally:
            listening.cancel()
            ended.cancel()
            await asyncio.gather(listening, ended, return_exceptions=True)
        if self._failure is not None:
            raise self._failure
        for reason, count in self.bus.dropped.items():
            self._complain(f"{self.bus.info.name}: {reason} ({amount(count, 'time')})")

    async def run_with(self, work: Coroutine[object, object, None]) -> None:
        """Listen as long as `work` runs.

        Raises:
            LinkDown: the bus cannot be opened.
            Exception: what the work raises.
        """
        working = asyncio.get_running_loop().create_task(work)
        working.add_done_callback(lambda _: self.finish())
        try:
            await self.run()
        finally:
            working.cancel()
            await asyncio.wait((working,))
        if not working.cancelled():
            working.result()

    def _state(self, state: BusState, words: str, _now: float) -> None:
        self.state = state
        if state is BusState.ACTIVE:
            self.opened.set()
        elif self.opened.is_set():
            self._complain(f"{self.bus.info.name} is {state.value}: {words}")


# What the masters of this computer know of a bus: the dump did not hear what parts set up before it began.


@dataclass(slots=True)
class RobotOnBus:
    """The objects and message types of the robot, or the robots, on a bus."""

    objects: dict[tuple[Hashable, int], KnownObject] = field(default_factory=dict)
    """By node and object id."""
    types: dict[str, MessageType] = field(default_factory=dict)
    """By name."""

    def learn_object(self, node: Hashable, object_id: int) -> KnownObject | None:
        """An object of the client at a node."""
        return self.objects.get((node, object_id))


def robot_on_bus(address: str, complain: Callable[[str], None]) -> RobotOnBus | None:
    """Ask the masters that run on this computer; None: none of them serves that bus, which is said.

    Args:
        address: the bus.
        complain: takes what is wrong.

    Raises:
        ConfigError: the folder in which masters leave word is not the user's own.
    """
    bus = open_bus(address, node="dump", listen_only=True).info.name
    found = RobotOnBus()
    served = False
    for process in running_processes():
        try:
            served |= process.what == MASTER and _add(found, process, bus)
        except ConfigError as error:
            complain(str(error))
    if served:
        return found
    complain(f"no master on this computer serves {bus}: what joined before has no sentences until it joins again")
    return None


def _add(found: RobotOnBus, process: RunningProcess, bus: str) -> bool:
    """Add what a master knows of a bus; whether it serves that bus."""
    answer = process.ask({"do": "objects", "args": {}, "who": user_name()})
    try:
        rows = _mapping(answer.get("buses", {})).get(bus)
        if rows is None:
            return False
        for node, object_id, *words in rows:
            found.objects.setdefault((int(node), int(object_id)), KnownObject(*map(str, words)))
        types: Any = answer.get("types", ())
        for one in types:
            fields = {
                str(name): {str(field): str(kind) for field, kind in _mapping(inner).items()}
                for name, inner in _mapping(one["fields"]).items()
            }
            units = {str(name): str(unit) for name, unit in _mapping(one["units"]).items()}
            name = str(one["name"])
            found.types.setdefault(name, type_from_words(name, fields, units))
    except (ValueError, TypeError, KeyError, ConfigError) as error:
        raise ConfigError(
            f"{process.what} {process.name}: its answer about {bus} makes no sense ({error!r})"
        ) from error
    return True


def _mapping(value: object) -> Mapping[str, Any]:
    if not isinstance(value, dict):
        raise TypeError("no JSON object")
    return value
