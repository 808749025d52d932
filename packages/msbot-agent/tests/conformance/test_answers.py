"""About 100 hand-made packets that were given to a genuine agent: ours answers the same, unless said why not."""

from __future__ import annotations

from tests.agent.replay import Answers
from tests.conformance.agent_rig import AgentRig
from tests.conformance.answers import Section, sections

FILES = ["agent_answers_1.txt", "agent_answers_2.txt"]

DEAD = "the genuine agent has aborted or hangs"
UNSEEN = "part of the dialogue was not recorded"
DIFFERENT = {
    "create, key 0": "the genuine agent sends stale bytes behind the status",
    "GET_INFO truncated": "answered with zeros; here silence",
    "old session id 0x81 still used on that endpoint": "taken for the new session; here a late packet of the old one",
    "HEARTBEAT first 4 last 5 (skips)": "number 18, which came beyond the window, is asked for again",
    "HEARTBEAT for best-effort stream 1": "answered with garbage; here silence",
    "unknown submessage 0x20 then CREATE in same message": "the rest of the message is dropped; here done",
    "STATUS sent to agent then CREATE": "the rest of the message is dropped; here done",
    "CREATE kind mismatch: object id 0015, variant participant": "STATUS numbers follow from the CREATEs done before",
    "CREATE kind 0x0c (application) / 0x0b / 0x0a": "STATUS numbers follow from the CREATEs done before",
    "CREATE representation format 9": "STATUS numbers follow from the CREATEs done before",
    "CREATE publisher by ref (format 1 not allowed)": "the description is read as a GET_INFO; here skipped",
    "WRITE_DATA unknown writer then CREATE": "the rest of the message is dropped; here done",
    "still alive?": DEAD,
    "two CREATE in one message, delete client afterwards in same message": DEAD,
    "DELETE client with stream 0x80": DEAD,
    "DELETE AGENT object fffd": DEAD,
    "TIMESTAMP on reliable stream": DEAD,
    "small MTU 20: STATUS fits? INFO?": DEAD,
    "MTU 12: STATUS is 14 bytes -> fragments": DEAD,
    "small MTU 20": "MTU below 24 is refused",
    "MTU 12 (STATUS 14 > 12)": "MTU below 24 is refused",
    "ack all 16 (first=16)": UNSEEN,
    "read on stream 0 (none), 2 samples": "DATA follows the ACKNACK, from another thread; here it precedes it",
    "cancel with data available within 100 ms": "a cancelled read goes on; here it ends",
    "read format 0x02 (SAMPLE) -> still FORMAT_DATA": "samples of the cancelled read still wait here",
    "write length 0 (no data: 4)": "samples of the cancelled read still wait here",
    "best-effort DATA larger than MTU": UNSEEN,
    "reliable DATA larger than MTU 64 -> fragments": UNSEEN,
    "fragments sent to the agent: write split 3 ways": UNSEEN,
    "fragment out of order: 2nd before 1st": UNSEEN,
    "fragment with two submessages inside": UNSEEN,
    "partial fragment, then RESET, then a complete fragmented write": UNSEEN,
    "sequence wrap on reliable: write 65536+10 messages": UNSEEN,
    "CREATE bin truncated inside sequence": DEAD,
    "CREATE bin: string length overflow inside sequence": "the hand-made length reaches beyond the message",
    "discovery, unicast to discovery port 27400": "the discovery port is another socket, see case 72",
}
"""Sections whose answers are others, by title; what is not said to be ours is the genuine agent's."""

WAITS = {"read elapsed 1 s, then write after 1.3 s": 1.3}
"""Seconds before the second packet."""


def answered(agent: AgentRig, section: Section, port: int) -> tuple[Answers, Answers]:
    """What the genuine agent and ours answered; order counts within a stream."""
    genuine, ours = Answers(), Answers()
    for number, step in enumerate(section.steps):
        peer = port - 1 if step.from_before else port
        if number:
            agent.wait(WAITS.get(section.title, 0.0), peer)
        if step.sent is None:
            agent.set_up(peer=peer)
            continue
        for packet in step.came:
            genuine.add(packet)
        for text in agent.say(step.sent, peer=peer):
            ours.add(bytes.fromhex(text))
    agent.wait(0.25, port)
    return genuine, ours


def test_answers_are_those_of_the_genuine_agent() -> None:
    different = set()
    for name in FILES:
        agent, port = AgentRig(), 0
        for section in sections(name):
            port += section.is_new
            genuine, ours = answered(agent, section, port)
            if genuine.streams != ours.streams:
                different.add(section.title)
                assert section.title in DIFFERENT, (section, dict(ours.streams))
        agent.close()
    assert different == DIFFERENT.keys()
