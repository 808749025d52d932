"""A program with a DDS space of its own, for tests that need another process.

    far_side.py '{"do": "write", "topic": "t", "type": "T", "qos": {...}, "count": 100, "size": 8}'

`write` waits for a reader and then writes numbered samples as fast as they go (without "count": for ever); `keep`
writes them at once for those that come later; `echo` sends what comes on "topic" back on "topic" + "_back". Each
prints `ready` when its endpoints exist, and `done` when all is written, and ends when its standard input does.
"""

from __future__ import annotations

import asyncio
import json
import sys
from typing import Any

from msbot_agent.space import Qos, Sample, Topic
from msbot_agent.space.dds import DdsSpace


def numbered(number: int, size: int) -> bytes:
    """The payload of a sample."""
    return number.to_bytes(4) + bytes(max(0, size - 4))


async def main(wish: dict[str, Any]) -> None:
    topic = Topic(wish["topic"], wish["type"])
    qos = Qos(**wish.get("qos", {}))
    with DdsSpace(wish.get("domain", 0)) as space:
        name = topic.name + "_back" if wish["do"] == "echo" else topic.name
        writer = space.writer(Topic(name, topic.type_name), qos, bytes(15) + b"\1")
        if wish["do"] == "echo":

            def back(sample: Sample) -> bool:
                writer.write(sample.payload)
                return True

            space.reader(topic, qos, back)
        say("ready")
        work = asyncio.create_task(write(wish, writer)) if wish["do"] != "echo" else None
        await asyncio.to_thread(sys.stdin.read)
        if work is not None:
            work.cancel()


async def write(wish: dict[str, Any], writer: Any) -> None:
    while wish["do"] == "write" and not any(outlet.has_readers for outlet in writer.outlets):  # noqa: ASYNC110
        await asyncio.sleep(0.005)
    number = 0
    while number != wish.get("count"):
        for _ in range(32):
            if number == wish.get("count"):
                break
            writer.write(numbered(number, wish.get("size", 8)))
            number += 1
        await asyncio.sleep(wish.get("pause_s", 0))
    say("done")


def say(words: str) -> None:
    print(words, flush=True)


if __name__ == "__main__":
    asyncio.run(main(json.loads(sys.argv[1])))
