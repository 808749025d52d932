"""What the frames around addresses, STOP and faults say, in sentences for everybody. Pure."""

from __future__ import annotations

from msbot_agent.link.can.protocol.frames import Frame
from msbot_agent.link.can.protocol.ids import (
    NOBODY,
    NODES,
    CanIds,
    read_assign,
    read_beacon,
    read_join,
    read_question,
    read_stop,
)
from msbot_agent.text.sentence import Sentence, said


def node_of(frame: Frame, ids: CanIds) -> tuple[int, bool] | None:
    """The node whose message a frame is a piece of, and whether it goes to the master; None: it is no such piece."""
    if frame.extended or frame.error or frame.remote:
        return None
    for base, up in ((ids.up, True), (ids.down, False)):
        if 0 < frame.can_id - base <= NODES:
            return frame.can_id - base, up
    return None


def frame_sentence(frame: Frame, ids: CanIds) -> Sentence:
    """What a frame says that is no piece of a message between a part and the master."""
    if frame.error:
        return said("the bus reports a fault")
    if read_stop(frame, ids) is not None:
        return said("STOP: every part goes to its safe state")
    if read_join(frame, ids):
        return said("a part asks for an address")
    if assign := read_assign(frame, ids):
        if assign.uid == NOBODY:
            return said("node {node} must ask for an address again", node=assign.node_id)
        if assign.node_id == 0:
            return said("the master has no address left for a part")
        return said("the master makes a part node {node}", node=assign.node_id)
    if read_beacon(frame, ids):
        return said("the master says that it is there")
    if read_question(frame, ids) is not None:
        return said("a master starts and asks whether there is another one")
    return said("something else that uses this bus")
