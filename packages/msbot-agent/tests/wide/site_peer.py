"""A program of a site that uses DDS and knows nothing of other sites.

It prints `TOPIC NUMBER` for each sample that it reads, and writes the numbers of each line `TOPIC FIRST LAST` that it
reads from its standard input.
"""

from __future__ import annotations

import asyncio
import sys
from functools import partial

from msbot_agent.space import Qos, Sample, Topic
from msbot_agent.space.dds import DdsSpace

QOS = Qos(depth=256, partitions=("msbot/ROVER",))
TOPICS = {name: Topic(name, "Number") for name in ("light", "back", "secret")}


def show(name: str, sample: Sample) -> bool:
    print(name, int.from_bytes(sample.payload), flush=True)
    return True


async def main() -> None:
    with DdsSpace(7, interface="lo") as space:
        writers = {}
        for number, (name, topic) in enumerate(TOPICS.items()):
            writers[name] = space.writer(topic, QOS, bytes(15) + bytes([number]))
            if name == sys.argv[1]:
                continue  # this site is the one that says it
            space.reader(topic, QOS, partial(show, name))
        print("ready", flush=True)
        while line := await asyncio.to_thread(sys.stdin.readline):
            name, first, last = line.split()
            for value in range(int(first), int(last) + 1):
                writers[name].write(value.to_bytes(8))


asyncio.run(main())
