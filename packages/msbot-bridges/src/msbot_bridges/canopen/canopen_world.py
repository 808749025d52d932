"""All nodes of one CANopen bus: found by what they send, and by asking all node ids; missed when they fall silent.

Devices without a node id get one (LSS). A node that sends no heartbeat is asked for its state (node guarding), or, when
it does not answer that, for its error register.
"""

from __future__ import annotations

import asyncio
from functools import partial
from typing import Final

from msbot_bridges.bridge import World, WorldHost
from msbot_bridges.canopen import objects
from msbot_bridges.canopen.canopen_bus import EMERGENCY, HEARTBEAT, SDO_ANSWER, CanopenBus
from msbot_bridges.canopen.canopen_device import GUARD_MS, CanopenDevice
from msbot_bridges.canopen.drive_device import DriveDevice
from msbot_bridges.canopen.eds_folder import EdsFolder
from msbot_bridges.canopen.lss import ANSWER_ID, ANSWER_S, SETTLE_S, LssFailure, LssNodeIds, Numbered, number_one
from msbot_bridges.canopen.mapped_device import MappedDevice
from msbot_bridges.canopen.node_description import NodeDescription

LOOK_S: Final = 0.1
SEARCH_S: Final = 10.0
"""So often all node ids are asked."""
PROBE_S: Final = 1.0
"""So often a node that was only heard is asked whether it answers; it costs one frame, and nobody waits."""
LONGEST_PAUSE_S: Final = 60.0
ASK_AGAIN_S: Final = 2.0
"""Time after which a node that could not be asked, or of which no part can be made, is asked again."""
BEATS: Final = 3
"""Heartbeats that may be missing."""
LEAST_SILENCE_S: Final = 1.0
POLL_S: Final = 1.0
"""A node that sends no heartbeat is asked so often."""
GUARD_S: Final = GUARD_MS / 1000
LSS_FIRST_S: Final = 1.0
"""By then the nodes that have ids are known."""
LSS_S: Final = 3.0
"""So often devices without a node id are searched for."""
MOST_ANSWERS: Final = 200
MOST_TOLD: Final = 3
"""Sentences about one node of which no part can be made: its answers may be others each time."""
BOOT_UP: Final = 0


class _Node:
    """What is known of one node id."""

    def __init__(self, node_id: int, now: float) -> None:
        self.node_id = node_id
        self.heard_at = now
        self.has_answered = False
        """It has answered a question by SDO: a node that only seems to be there has not, and holds up nobody."""
        self.pause_s = ASK_AGAIN_S
        """Until it is asked again; doubled each time."""
        self.ask_at: float | None = now
        """None: it is being asked, or is known."""
        self.poll_at = now
        self.is_guarded = False
        """It sends no heartbeat, and has answered when it was asked for its state."""
        self.device: CanopenDevice | None = None

    @property
    def beat_s(self) -> float:
        """Period of its heartbeat; 0: it sends none."""
        return 0.0 if self.device is None else self.device.heartbeat_ms / 1000


class CanopenWorld(World):
    """See the module's docstring.

    Args:
        address: `INTERFACE:CHANNEL[?bitrate=N]` of python-can.
        folder: EDS files.
        gives_ids: devices without a node id get one.
    """

    def __init__(self, address: str, folder: EdsFolder, *, gives_ids: bool = True) -> None:
        self._address, self._folder, self._gives_ids = address, folder, gives_ids
        self._nodes: dict[int, _Node] = {}
        self._ids = LssNodeIds()
        self._lss_answers = asyncio.Queue[bytes](MOST_ANSWERS)
        self._lss_trouble = ""
        self._told = dict[int, list[str]]()
        """Why no part is made of a node, as was said since it was one."""

    async def run(self, host: WorldHost) -> None:
        """See `World`."""
        self._host, self._loop = host, asyncio.get_running_loop()
        bus = self._bus = CanopenBus(self._address, self._folder, self._heard, host.say)
        tasks = [asyncio.create_task(bus.run()), asyncio.create_task(self._watch())]
        if self._gives_ids:
            tasks.append(asyncio.create_task(self._give_ids()))
        try:
            await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
        finally:
            for task in tasks:
                task.cancel()
            await asyncio.wait(tasks)
        for task in tasks:
            if not task.cancelled() and (error := task.exception()) is not None:
                raise error

    async def _watch(self) -> None:
        await self._bus.opened()
        search_at = self._loop.time()
        while True:
            now = self._loop.time()
            if now >= search_at:
                search_at = now + SEARCH_S
                self._bus.search(set(self._nodes))
            for node in list(self._nodes.values()):
                self._look(node, now)
            await asyncio.sleep(LOOK_S)

    def _look(self, node: _Node, now: float) -> None:
        silence = max(LEAST_SILENCE_S, BEATS * (node.beat_s or POLL_S))
        if now - node.heard_at > silence:
            what = "no heartbeat" if node.beat_s else "no answer"
            self._lose(node, f"node {node.node_id} has sent {what} for {silence:g} s")
        elif node.ask_at is not None and now >= node.ask_at and not node.has_answered:
            node.ask_at = now + PROBE_S
            self._bus.probe(node.node_id)
        elif node.ask_at is not None and now >= node.ask_at:
            node.ask_at = None
            self._bus.describe(node.node_id, partial(self._described, node))
        elif node.device is not None and not node.beat_s and now >= node.poll_at:
            node.poll_at = now + (GUARD_S if node.is_guarded else POLL_S)
            self._bus.guard(node.node_id)
            if not node.is_guarded:
                self._bus.read(node.device, [objects.ERROR_REGISTER])

    def _heard(self, can_id: int, data: bytes) -> None:
        if can_id == ANSWER_ID:
            if not self._lss_answers.full() and len(data) == 8:
                self._lss_answers.put_nowait(data)
            return
        now, node_id = self._loop.time(), can_id & 0x7F
        node = self._nodes.get(node_id)
        if node is None:
            node = self._nodes[node_id] = _Node(node_id, now)
        node.heard_at = now
        service = can_id & 0x780
        if service == SDO_ANSWER and not node.has_answered:
            node.has_answered = True
            node.ask_at = None if node.ask_at is None else now
        if service == HEARTBEAT and data:
            state = data[0] & 0x7F  # the other bit is of node guarding
            if state == BOOT_UP:
                if node.device is not None:
                    node.device.is_reset = True
                    self._lose(node, f"node {node_id} has started anew")
                    self._nodes[node_id] = _Node(node_id, now)
            elif node.device is not None:
                node.is_guarded = not node.beat_s
                node.device.heartbeat(state)
        elif service == EMERGENCY and len(data) >= 3:
            if node.device is not None:
                node.device.emergency(int.from_bytes(data[:2], "little"), data[2])
        elif node.device is not None:
            node.device.received(can_id, data)

    async def _give_ids(self) -> None:
        await self._bus.opened()
        await asyncio.sleep(LSS_FIRST_S)
        while True:
            try:
                numbered = await self._number_one()
            except LssFailure as error:
                numbered = None
                if str(error) != self._lss_trouble:
                    self._lss_trouble = str(error)
                    self._host.say(str(error))
            if numbered is None:
                await asyncio.sleep(LSS_S)
                continue
            self._lss_trouble = ""
            keeps = "keeps it" if numbered.is_kept else "does not keep it: it gets one again when it is switched on"
            self._host.say(f"a device ({numbered.address}) has got the node id {numbered.node_id}, and {keeps}")

    async def _number_one(self) -> Numbered | None:
        """Give one device without a node id an id; None: there is none."""
        questions = number_one(self._ids, self._nodes)
        answer: bytes | None = None
        try:
            question = next(questions)
            while True:
                while not self._lss_answers.empty():  # of devices that were slow
                    self._lss_answers.get_nowait()
                self._bus.ask_all(question.data)
                answer = await self._lss_answer() if question.is_answered else None
                question = questions.send(answer)
        except StopIteration as end:
            found: Numbered | None = end.value
            return found

    async def _lss_answer(self) -> bytes | None:
        try:
            async with asyncio.timeout(ANSWER_S):
                answer = await self._lss_answers.get()
        except TimeoutError:
            return None
        await asyncio.sleep(SETTLE_S)
        return answer

    def _described(self, node: _Node, found: NodeDescription | str) -> None:
        if self._nodes.get(node.node_id) is not node:
            return
        if isinstance(found, str):
            node.has_answered = False
            node.ask_at = self._loop.time() + node.pause_s
            node.pause_s = min(2 * node.pause_s, LONGEST_PAUSE_S)
            told = self._told.setdefault(node.node_id, [])
            if found not in told and len(told) < MOST_TOLD:
                told.append(found)
                self._host.say(found)
            return
        self._told.pop(node.node_id, None)
        make = MappedDevice if found.drive is None else DriveDevice
        node.device = make(found, self._bus, self._host.news)
        if found.left_out:
            self._host.say(f"node {node.node_id}: {found.left_out} of its ports left out for want of room")
        self._host.found(node.device)

    def _lose(self, node: _Node, why: str) -> None:
        del self._nodes[node.node_id]
        self._bus.forget(node.node_id)
        if node.device is not None:
            self._host.lost(node.device, why)
