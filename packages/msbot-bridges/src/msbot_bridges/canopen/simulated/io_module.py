"""A simulated input and output module (CiA 401): eight inputs, eight outputs, an analogue one of each; wired to itself.

Its outputs are its inputs: what is switched on at `out_1` is seen at `in_1`.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

from canopen.objectdictionary import ObjectDictionary

from msbot_bridges.canopen import objects
from msbot_bridges.canopen.objects import Entry
from msbot_bridges.canopen.simulated.local_device import LocalDevice, add, add_pdos, add_text

INPUTS: Final = Entry(objects.DIGITAL_INPUTS, 1, 8)
OUTPUTS: Final = Entry(objects.DIGITAL_OUTPUTS, 1, 8)
POLARITY: Final = Entry(0x6002, 1, 8)
LEVEL_IN: Final = Entry(objects.ANALOGUE_INPUTS, 1, 16, signed=True)
LEVEL_OUT: Final = Entry(objects.ANALOGUE_OUTPUTS, 1, 16, signed=True)


def dictionary(node_id: int, serial: int) -> ObjectDictionary:
    """The objects of the module."""
    made = ObjectDictionary()
    add(made, "Device type", objects.DEVICE_TYPE, 401 | 0xF << 16, is_writable=False)
    add(made, "Error register", objects.ERROR_REGISTER, 0, is_writable=False)
    add_text(made, "Device name", objects.DEVICE_NAME, "SimIO")
    add(made, "Producer heartbeat", objects.PRODUCER_HEARTBEAT, 0)
    for name, entry, value in (
        ("Identity vendor", objects.VENDOR, 0x4D53),
        ("Identity product", objects.PRODUCT, 0x401),
        ("Identity revision", objects.REVISION, 0x10000),
        ("Identity serial", objects.SERIAL, serial),
    ):
        add(made, name, entry, value, is_writable=False)
    add_pdos(made, node_id, (1, 2), (1, 2))
    for name, entry, value in (
        ("Inputs 1 to 8", INPUTS, 0),
        ("Polarity 1 to 8", POLARITY, 0),
        ("Outputs 1 to 8", OUTPUTS, 0),
        ("Levels in 1", LEVEL_IN, 0),
        ("Levels out 1", LEVEL_OUT, 0),
    ):
        add(made, name, entry, value)
    add(made, "Analogue interrupts", objects.ANALOGUE_INTERRUPTS, 0)
    return made


class SimulatedIo(LocalDevice):
    """The module.

    Args:
        address: `INTERFACE:CHANNEL[?bitrate=N]` of python-can.
        node_id: where it is on its bus.
        serial: tells it from others of its kind; its node id unless given.
    """

    def __init__(self, address: str, node_id: int = 6, serial: int | None = None) -> None:
        super().__init__(address, node_id, dictionary(node_id, node_id if serial is None else serial))

    def received(self, values: Mapping[tuple[int, int], int]) -> None:
        """See `LocalDevice`."""
        for entry in (OUTPUTS, LEVEL_OUT):
            if (value := values.get((entry.index, entry.subindex))) is not None:
                self.put(entry, value)

    def step(self, seconds: float) -> None:  # noqa: ARG002 - outputs follow at once
        """See `LocalDevice`."""
        self.put(INPUTS, self.get(OUTPUTS) ^ self.get(POLARITY))
        if self.get(objects.ANALOGUE_INTERRUPTS):
            self.put(LEVEL_IN, self.get(LEVEL_OUT))
