"""A simulated device that loads the library, and the data types, only when it runs."""

from __future__ import annotations

from msbot_bridges.cyphal.data_types import load_types


class SimulatedCyphalDevice:
    """A range finder or a servo.

    Args:
        kind: `range` or `servo`.
        address: `INTERFACE:CHANNEL[?bitrate=N]` of python-can.
        node_id: where it is on its bus; 0: it asks for a node id.
    """

    def __init__(self, kind: str, address: str, node_id: int) -> None:
        self._kind, self._address, self._node_id = kind, address, node_id

    async def run(self) -> None:
        """See `msbot_bridges.bridge.SimulatedDevice`."""
        await load_types()
        from msbot_bridges.cyphal.simulated.range_finder import SimulatedRange
        from msbot_bridges.cyphal.simulated.servo import SimulatedCyphalServo

        kind = SimulatedRange if self._kind == "range" else SimulatedCyphalServo
        await kind(self._address, self._node_id).run()
