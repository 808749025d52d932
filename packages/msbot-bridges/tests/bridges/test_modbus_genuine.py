"""pymodbus' server as a pump, by TCP and on a serial line: found, read, driven, stopped as it is read back, lost."""

from __future__ import annotations

import asyncio
import os
import select
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from msbot import Message
from msbot.part.messages.standard import Speed, Switch, Temperature
from msbot_bridges.bridge import BridgeLink, World
from tests.bridges.hosting import Host, Program, program, running

pytest.importorskip("pymodbus")
PUMP = Path(__file__).parents[4] / "examples" / "makers" / "pump.toml"
Heard = asyncio.Queue[tuple[str, Message]]


def world(address: str, table: Path = PUMP) -> World:
    from msbot_bridges.modbus.world import open_world

    return open_world(BridgeLink(address, {"table": str(table)}))


async def until(heard: Heard, port: str, message: Message) -> None:
    while await heard.get() != (port, message):
        pass


async def pump_is_a_part(server: Program, host: Host) -> None:
    device = await host.devices.get()
    assert device.identity.part_number == "Genuine:P-7"
    assert device.identity.software == "2.1"
    assert [(one.name, one.safe) for one in device.inputs] == [("speed", Speed(rpm=0)), ("valve", Switch(on=False))]
    assert [(one.name, one.default, one.least, one.most, one.unit) for one in device.settings] == [
        ("ramp", 2.0, 0.5, 60.0, "s")
    ]
    heard = Heard()
    device.set("ramp", 3.0)
    assert await server.line("written") == "holding 40 30"
    device.begin(lambda port, message: heard.put_nowait((port, message)))
    await until(heard, "temperature", Temperature(celsius=21.5))
    await until(heard, "dry", Switch(on=True))
    device.act("speed", Speed(rpm=1200))
    assert await server.line("written") == "holding 16 2400"
    await until(heard, "turns", Speed(rpm=1200))
    device.act("valve", Switch(on=True))
    assert await server.line("written") == "coil 3 1"

    # The order has come, and the motor turns on: that is no confirmation.
    await server.tell("stuck")
    device.stop()
    assert {await server.line("written"), await server.line("written")} == {"holding 16 0", "coil 3 0"}
    while device.not_stopped != "unit 1 has not been read with the safe value of turns":
        await heard.get()
    await server.tell("loose")
    await host.told.wait()
    assert device.not_stopped == ""

    # Somebody else writes it while STOP holds: it is written again.
    host.told.clear()
    await server.tell("write 16 500")
    assert await server.line("written") == "holding 16 0"
    await host.told.wait()
    device.go()
    device.act("speed", Speed(rpm=9000))
    assert await server.line("written") == "holding 16 6000", "the range of the table holds"
    server.kill()
    await host.lost_why.get()


async def test_a_pump_by_tcp(tmp_path: Path) -> None:
    with program("modbus_server.py", "tcp") as server:
        port = await server.line("ready")
        async with running(world(f"tcp:127.0.0.1:{port}")) as host:
            await pump_is_a_part(server, host)


@contextmanager
def line_of_two_ends() -> Iterator[tuple[str, str]]:
    """Two pseudo-terminals whose octets go from one to the other: a serial line."""
    masters, names, ends = [], [], []
    for _ in range(2):
        master, end = os.openpty()
        masters.append(master)
        ends.append(end)
        names.append(os.ttyname(end))
    leave, left = os.pipe()

    def carry() -> None:
        while True:
            ready, _, _ = select.select([*masters, leave], [], [])
            if leave in ready:
                return
            for master in ready:
                os.write(masters[1 - masters.index(master)], os.read(master, 4096))

    carrier = threading.Thread(target=carry)
    carrier.start()
    try:
        yield names[0], names[1]
    finally:
        os.write(left, b"x")
        carrier.join()
        for one in (*masters, *ends, leave, left):
            os.close(one)


@pytest.mark.skipif(sys.platform != "linux", reason="a line of two pseudo-terminals")
async def test_a_pump_on_a_serial_line() -> None:
    with line_of_two_ends() as (ours, theirs), program("modbus_server.py", "rtu", theirs) as server:
        await server.line("ready")
        async with running(world(f"rtu:{ours}?baud=19200&parity=N")) as host:
            await pump_is_a_part(server, host)


async def test_a_table_that_does_not_fit_is_named(tmp_path: Path) -> None:
    table = tmp_path / "other.toml"
    table.write_text(PUMP.read_text().replace("address = 40", "address = 41"))
    with program("modbus_server.py", "tcp") as server:
        port = await server.line("ready")
        async with running(world(f"tcp:127.0.0.1:{port}", table)) as host:
            assert (
                await host.saying.get()
                == "unit 1: holding 41 to 41: it has no such address: the table pump does not fit"
            )


async def test_the_simulated_devices_of_a_table_are_found() -> None:
    from msbot_bridges.modbus.address import read_address
    from msbot_bridges.modbus.simulated import SimulatedLine
    from msbot_bridges.modbus.world import tables_of
    from tests.e2e.test_processes import free_port

    address = f"tcp:127.0.0.1:{free_port()}"
    link = BridgeLink(address, {"table": str(PUMP)})
    simulated = asyncio.create_task(SimulatedLine(read_address(address), tables_of(link)).run())
    try:
        await asyncio.sleep(0)
        while True:
            try:
                _, writer = await asyncio.open_connection("127.0.0.1", int(address.rpartition(":")[2]))
            except OSError:
                await asyncio.sleep(0.02)
            else:
                writer.close()
                break
        async with running(world(address)) as host:
            device = await host.devices.get()
            assert device.identity.part_number == "ACME:pump"
            heard = Heard()
            device.begin(lambda port, message: heard.put_nowait((port, message)))
            device.act("speed", Speed(rpm=700))
            await until(heard, "turns", Speed(rpm=700))
            device.stop()
            await host.told.wait()
            await until(heard, "turns", Speed(rpm=0))
    finally:
        simulated.cancel()
        await asyncio.wait([simulated])


async def test_where_nothing_listens_the_sentence_says_so() -> None:
    from msbot_xrce.errors import LinkDown

    with pytest.raises(LinkDown, match="1 cannot be opened"):
        await world("tcp:127.0.0.1:1").run(Host())
