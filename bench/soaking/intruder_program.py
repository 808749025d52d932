"""Those who must get nothing: strangers who read and write the robot's topics, parts with wrong numbers and keys.

    python -m bench.soaking.intruder_program LINK --topics ring_0,ring_1 --uids 00..,01.. [--keys]

Each line on stdout is a JSON list: "intruded" with the time and what somebody was given, which must never be said;
"tried" with the number of tries, so that it can be seen that they do try.
"""

from __future__ import annotations

import argparse
import asyncio
import json
import os
import socket
import time
from contextlib import suppress
from dataclasses import replace
from random import Random

from msbot import HelloWorld, Part
from msbot.part import Client
from msbot.part.run import CAN
from msbot_agent.link import open_link
from msbot_agent.link.can import CanSettings
from msbot_xrce.errors import LinkError, MsbotError

IP = ("udp:", "tcp:")
TRY_S = 1.0
COUNT_S = 5.0
AGAIN_S = 0.5
GARBAGE = 8
"""Packets of garbage at a time."""


def say(*event: object) -> None:
    """One line in one write."""
    os.write(1, json.dumps(event, separators=(",", ":")).encode() + b"\n")


class Intruders:
    """All of them, and how often they have tried."""

    def __init__(self, link: str, topics: list[str], uids: list[str], *, keys: bool) -> None:
        self.link, self.topics, self.uids, self.keys = link, topics, uids, keys
        self.tried = 0
        self.dice = Random()

    async def read_and_write(self) -> None:
        """A client without a part: reads every topic, and writes to it what would be believed."""

        def given(_object: int, _request: int, payload: bytes) -> None:
            say("intruded", time.monotonic(), "a stranger was delivered", payload[:60].hex())

        client = Client(open_link(self.link, can=self._can()), key=self.dice.getrandbits(32), on_topic=given)
        participant = client.create_participant("stranger")
        publisher, subscriber = client.create_publisher(participant), client.create_subscriber(participant)
        writers = []
        for name in self.topics:
            topic = client.create_topic(participant, name, "HelloWorld")
            writers.append(client.create_writer(publisher, topic))
            client.read(client.create_reader(subscriber, topic))
        false = HelloWorld(index=0, message=f"{'S0'} 00000000 1 0 00000000 ").encode()
        async with asyncio.TaskGroup() as tasks:
            tasks.create_task(client.run())
            while True:
                await asyncio.sleep(TRY_S)
                with suppress(MsbotError):  # not connected, or no room: the next time
                    for writer in writers:
                        client.write(writer, false)
                        self.tried += 1

    async def be_part(self, number: str, uid: bytes, key: bytes | None, name: str) -> None:
        """A part that is not one."""
        part = Part(number, local_name=name, uid=uid, key=key)

        @part.on("in", HelloWorld, optional=True)
        def given(message: HelloWorld) -> None:
            say("intruded", time.monotonic(), f"{number} {name} was delivered", message.message[:60])

        @part.on_join
        def joined() -> None:
            say("intruded", time.monotonic(), f"{number} {name} has joined slot {part.slot}", uid.hex())

        self.tried += 1
        await part.run_async(open_link(self.link, can=self._can(uid)))

    async def throw_garbage(self) -> None:
        """Octets, and the beginnings of real messages, from ever new addresses."""
        kind, _, rest = self.link.partition(":")
        if kind != "udp":
            return
        host, _, port = rest.rpartition(":")
        while True:
            with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as one:
                one.setblocking(False)
                for _ in range(GARBAGE):
                    session = self.dice.choice((0x80, 0x81, 0x82, 0x00))
                    with suppress(OSError):  # nobody listens, or no room
                        one.sendto(bytes([session, *self.dice.randbytes(self.dice.randrange(60))]), (host, int(port)))
                    self.tried += 1
            await asyncio.sleep(TRY_S)

    async def tell(self) -> None:
        """How often they have tried."""
        while True:
            await asyncio.sleep(COUNT_S)
            say("tried", time.monotonic(), self.tried)

    async def again(self, one: str) -> None:
        """One of them, over and over."""
        while True:
            uid = self.dice.randbytes(8)
            with suppress(LinkError, OSError, TimeoutError, ExceptionGroup):  # the master is away: later
                async with asyncio.timeout(5 + 10 * self.dice.random()):
                    if one == "client":
                        await self.read_and_write()
                    elif one == "wrong number":
                        await self.be_part("SOAK", uid, None, "S0")
                    elif one == "no key":
                        await self.be_part("SOAK-S0", self._known(), None, "S0")
                    elif one == "wrong key":
                        wrong = self.dice.randbytes(16)
                        await self.be_part("SOAK-S1", self._known(), wrong, "S1")
                    elif one == "unknown UID":
                        await self.be_part("SOAK-S2", uid, self.dice.randbytes(16), "S2")
            await asyncio.sleep(AGAIN_S)

    async def run(self) -> None:
        """All of them."""
        kinds = ["client", "wrong number", *(["no key", "wrong key", "unknown UID"] if self.keys else [])]
        async with asyncio.TaskGroup() as tasks:
            tasks.create_task(self.tell())
            tasks.create_task(self.throw_garbage())
            for kind in kinds:
                tasks.create_task(self.again(kind))

    def _known(self) -> bytes:
        """The UID of a part of the robot; not on a bus, where the link itself knows its nodes by it."""
        return bytes.fromhex(self.dice.choice(self.uids)) if self.link.startswith(IP) else self.dice.randbytes(8)

    def _can(self, uid: bytes | None = None) -> CanSettings:
        return replace(CAN, uid=uid or self.dice.randbytes(8))


def main() -> None:
    """Try until a signal comes."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n", maxsplit=1)[0])
    parser.add_argument("link")
    parser.add_argument("--topics", required=True)
    parser.add_argument("--uids", required=True)
    parser.add_argument("--keys", action="store_true", help="the robot has keys: a right number alone is not enough")
    options = parser.parse_args()
    intruders = Intruders(options.link, options.topics.split(","), options.uids.split(","), keys=options.keys)
    asyncio.run(intruders.run())


if __name__ == "__main__":
    main()
