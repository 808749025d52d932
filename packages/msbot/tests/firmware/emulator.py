"""A board in the emulator, as a node of a simulated bus that runs in real time.

The board's serial line is its bus (slcan, `examples/slcan.c`): this side plays the computer that opens the channel, and
hands frames to and fro between the board and a controller on the simulated bus. A second line is its two pins.
"""

from __future__ import annotations

import asyncio
import contextlib
import signal
from collections import deque
from pathlib import Path

from tests.firmware.msbot_side import Frame, SimCanBus

PATIENCE_S = 60.0
"""How long a test waits for anything; nothing here takes that long by itself."""
ASK_S = 0.05
"""How often a board that has just been switched on is asked whether it is awake."""


class Emulator:
    """One STM32F405; `start` it inside a running loop."""

    def __init__(self, program: Path) -> None:
        self.pin: bool | None = None
        """The level that the board drives."""
        self.frames = 0
        """Frames that the board has sent."""
        self._program = program
        self._is_awake = False
        self._process: asyncio.subprocess.Process | None = None
        self._bus: SimCanBus | None = None
        self._outbox: deque[Frame] = deque()
        self._lines: dict[str, asyncio.StreamWriter] = {}
        self._servers: list[asyncio.Server] = []
        self._tasks: list[asyncio.Task[None]] = []

    async def start(self, bus: SimCanBus) -> None:
        """Power up, with this controller as its own."""
        connected = [asyncio.Event(), asyncio.Event()]
        ports = [
            await self._listen("bus", self._read_bus, connected[0]),
            await self._listen("pins", self._read_pins, connected[1]),
        ]
        serial = [word for port in ports for word in ("-serial", f"tcp:127.0.0.1:{port},nodelay=on")]
        self._process = await asyncio.create_subprocess_exec(
            "qemu-system-arm",
            "-M",
            "netduinoplus2",
            "-nodefaults",
            "-display",
            "none",
            "-monitor",
            "none",
            *serial,
            "-kernel",
            str(self._program),
            stdin=asyncio.subprocess.DEVNULL,
        )
        async with asyncio.timeout(PATIENCE_S):
            for event in connected:
                await event.wait()
        async with asyncio.timeout(PATIENCE_S):
            while not self._is_awake:  # what is said before it listens is lost
                self._lines["bus"].write(b"\rV\r")
                await asyncio.sleep(ASK_S)
        self._bus = bus
        bus.attach(frame=self._frame_on_bus, room=lambda _now: self._send_on())
        self._lines["bus"].write(b"C\rS6\rO\r")

    async def end(self) -> None:
        """Take its power away."""
        self._bus = None
        if self._process is not None:
            if self._process.returncode is None:
                self._process.kill()
            await self._process.wait()
        for task in self._tasks:
            task.cancel()
        for writer in self._lines.values():
            writer.close()
        for server in self._servers:
            server.close()
        await asyncio.gather(*self._tasks, return_exceptions=True)

    def freeze(self) -> None:
        """Stop it in the middle of whatever it does."""
        assert self._process is not None
        self._process.send_signal(signal.SIGSTOP)

    def thaw(self) -> None:
        """Let it go on."""
        assert self._process is not None
        self._process.send_signal(signal.SIGCONT)

    def apply(self, level: bool) -> None:
        """Put a level on the pin that the board reads."""
        self._lines["pins"].write(b"1" if level else b"0")

    async def _listen(self, name: str, read: object, connected: asyncio.Event) -> int:
        def accept(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
            self._lines[name] = writer
            assert callable(read)
            self._tasks.append(asyncio.get_running_loop().create_task(read(reader)))
            connected.set()

        server = await asyncio.start_server(accept, "127.0.0.1", 0)
        self._servers.append(server)
        port: int = server.sockets[0].getsockname()[1]
        return port

    async def _read_pins(self, reader: asyncio.StreamReader) -> None:
        while octets := await reader.read(100):
            self.pin = octets[-1:] == b"1"

    async def _read_bus(self, reader: asyncio.StreamReader) -> None:
        with contextlib.suppress(asyncio.IncompleteReadError):
            while True:
                line = (await reader.readuntil(b"\r"))[:-1].decode()
                assert "\a" not in line, "the board has refused a command"
                self._is_awake = self._is_awake or line[:1] == "V"
                if line[:1] in ("t", "T"):
                    self.frames += 1
                    self._outbox.append(_read_frame(line))
                    self._send_on()

    def _send_on(self) -> None:
        while self._bus is not None and self._outbox and self._bus.has_room():
            self._bus.send(self._outbox.popleft())

    def _frame_on_bus(self, frame: Frame, _now: float) -> None:
        if self._bus is not None:
            head = f"T{frame.can_id:08X}" if frame.extended else f"t{frame.can_id:03X}"
            self._lines["bus"].write(f"{head}{len(frame.data)}{frame.data.hex().upper()}\r".encode())


def _read_frame(line: str) -> Frame:
    extended = line[0] == "T"
    digits = 8 if extended else 3
    can_id, size, data = line[1 : digits + 1], line[digits + 1], line[digits + 2 :]
    frame = Frame(int(can_id, 16), bytes.fromhex(data), extended)
    assert len(frame.data) == int(size)
    return frame
