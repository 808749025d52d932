"""pymodbus' own server, in a process of its own: `tcp` on a free port, or `rtu` on a device; prints what is written.

Lines on its input: `stuck` and `loose` (whether the motor follows its order), `write ADDRESS VALUE`; each is
answered by `done`.
"""

from __future__ import annotations

import asyncio
import struct
import sys

from pymodbus.pdu.device import ModbusDeviceIdentification
from pymodbus.server import ModbusSerialServer, ModbusTcpServer
from pymodbus.simulator import DataType, SimData, SimDevice

holding = {16: 0, 40: 0}
coils = {3: 0}
motor = {"turns": 0.0, "stuck": False}


async def asked(function, start, address, count, registers, values):
    if values is not None:
        kept = coils if function in (5, 15) else holding
        for at, value in enumerate(values):
            kept[address + at] = int(value)
            print("written", "coil" if kept is coils else "holding", address + at, int(value), flush=True)
        if not motor["stuck"]:
            motor["turns"] = holding[16] * 0.5
        return
    if function == 4:
        one, two = struct.unpack(">HH", struct.pack(">f", motor["turns"]))
        for at in range(count):
            registers[address + at - start] = (two, one, 215)[address + at]
    if function == 3:
        for at in range(count):
            registers[address + at - start] = holding[address + at]


identity = ModbusDeviceIdentification(
    info_name={"VendorName": "Genuine", "ProductCode": "P-7", "MajorMinorRevision": "2.1"}
)


def device():
    bits, words = DataType.BITS, DataType.REGISTERS
    return SimDevice(
        1,
        (
            [SimData(3, values=[False], datatype=bits)],
            [SimData(0, values=[True], datatype=bits)],
            [SimData(16, values=[0], datatype=words), SimData(40, values=[0], datatype=words)],
            [SimData(0, values=[0, 0, 215], datatype=words)],
        ),
        action=asked,
    )


async def main():
    if sys.argv[1] == "tcp":
        server = ModbusTcpServer(device(), identity=identity, address=("127.0.0.1", 0))
        await server.serve_forever(background=True)
        print("ready", server.transport.sockets[0].getsockname()[1], flush=True)
    else:
        server = ModbusSerialServer(device(), identity=identity, port=sys.argv[2], baudrate=19200, parity="N")
        await server.serve_forever(background=True)
        print("ready", flush=True)
    while line := await asyncio.to_thread(sys.stdin.readline):
        words = line.split()
        if words[0] in ("stuck", "loose"):
            motor["stuck"] = words[0] == "stuck"
            if not motor["stuck"]:
                motor["turns"] = holding[16] * 0.5
        elif words[0] == "write":
            holding[int(words[1])] = int(words[2])
            motor["turns"] = holding[16] * 0.5
        print("done", flush=True)


asyncio.run(main())
