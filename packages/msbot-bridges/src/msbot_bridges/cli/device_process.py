"""A simulated device of a blueprint's bridge, in a process of its own: it is pulled out by killing that."""

from __future__ import annotations

import asyncio
import contextlib
import logging
import sys
from asyncio.subprocess import PIPE, Process
from collections.abc import Mapping
from typing import Final

from msbot.config import BridgeTable

END_S: Final = 5.0
"""Longest wait for a process to end by itself."""
_log = logging.getLogger("msbot.part")


class DeviceProcess:
    """See `msbot.cli.run.bridges_beside.PluggableDevice`.

    Args:
        table: its bridge.
        name: what is simulated, as its world calls it.
        options: as in the blueprint.
        part_number: what it will be in the robot; empty: it is not known beforehand.
    """

    def __init__(self, table: BridgeTable, name: str, options: Mapping[str, str], part_number: str) -> None:
        self.table = table
        self.name = name
        self.part_number = part_number
        self._options = options
        self._process: Process | None = None
        self._plugged = asyncio.Event()
        self._plugged.set()
        self._was_pulled = False

    @property
    def is_plugged(self) -> bool:
        """See `PluggableDevice`."""
        return self._plugged.is_set()

    def plug(self) -> bool:
        """See `PluggableDevice`."""
        if self.is_plugged:
            return False
        self._plugged.set()
        return True

    def unplug(self) -> bool:
        """See `PluggableDevice`."""
        if not self.is_plugged:
            return False
        self._plugged.clear()
        self._pull()
        return True

    def _pull(self) -> None:
        """Without a goodbye, as a cable is pulled."""
        self._was_pulled = True
        if self._process is not None:
            with contextlib.suppress(ProcessLookupError):
                self._process.kill()

    async def run(self, address: str) -> None:
        """Run it, as long as it is plugged in, until cancelled; one that ends by itself stays away.

        Args:
            address: where its network is.
        """
        words = [word for option, value in self._options.items() for word in ("--option", f"{option}={value}")]
        arguments = ["bridge", self.table.world, "--simulate", self.name, "--link", address, "--quiet"]
        while True:
            await self._plugged.wait()
            self._was_pulled = False
            # It ends with this process even if that is killed: its standard input ends then.
            # Ctrl-C at the terminal does not end it: the bridge first leaves it.
            self._process = await asyncio.create_subprocess_exec(
                *(sys.executable, "-m", "msbot", *arguments, "--end-with-stdin", *words),
                stdin=PIPE,
                start_new_session=True,
            )
            _log.info("simulated %s of %s: process %d", self.name, self.table.world, self._process.pid)
            try:
                if self._was_pulled:  # while it was being started
                    self._pull()
                status = await self._process.wait()
            finally:
                await self._end(self._process)
                self._process = None
            if not self._was_pulled:
                _log.warning("simulated %s of %s has ended (status %d)", self.name, self.table.world, status)
                self._plugged.clear()

    @staticmethod
    async def _end(process: Process) -> None:
        if process.returncode is not None:
            return
        with contextlib.suppress(ProcessLookupError):
            process.terminate()
        try:
            async with asyncio.timeout(END_S):
                await process.wait()
        except TimeoutError:
            process.kill()
            await process.wait()
