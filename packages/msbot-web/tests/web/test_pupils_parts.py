"""Pupils' programs at a running robot, over real WebSockets: held at the gate, STOP is heard all the same."""

from __future__ import annotations

import asyncio
from collections.abc import Generator

from msbot.part import HelloWorld, Part
from msbot.pnp import Freeze
from msbot_agent.space import Qos, Sample, Topic
from tests.web.part_site import part_site


async def test_a_freeze_holds_pupils_and_not_teachers_and_stop_is_confirmed() -> None:
    async with part_site() as site:
        heard = {"out0": 0, "out1": 0}

        def listen(topic: str) -> None:
            def count(_: Sample) -> bool:
                heard[topic] += 1
                return True

            site.master.space.reader(Topic(topic, "HelloWorld"), Qos(reliable=False), count)

        for topic in heard:
            listen(topic)
        inventory, now = site.master.inventory, asyncio.get_running_loop().time
        async with site.part(0, await site.token("bob")), site.part(1, await site.token("ada")):
            await site.until(lambda: site.active() == {"S0", "S1"} and min(heard.values()) > 2)
            assert inventory.pupil_parts.here() == {"bob": ("S0",)}
            inventory.pupil_parts.pupils.freeze = Freeze("ada", "", now())
            inventory.pupil_parts.follow(now())
            pupils, teachers = heard["out0"], heard["out1"]
            await site.until(lambda: heard["out1"] > teachers + 5)
            assert heard["out0"] == pupils
            assert site.active() == {"S0", "S1"}
            site.master.say_stop("ada")
            await site.until(lambda: not site.master.stop.silent)
            assert {one.part for one in site.master.stop.confirmed} == {"T0", "T1"}
            site.master.say_go("ada")
            inventory.pupil_parts.pupils.freeze = None
            inventory.pupil_parts.follow(now())
            await site.until(lambda: heard["out0"] > pupils + 2)


async def test_a_frozen_program_that_waits_says_nothing_and_hears_stop_and_go() -> None:
    async with part_site() as site:
        heard: list[str] = []
        done: list[str] = []

        def note(_: Sample) -> bool:
            heard.append("out0")
            return True

        site.master.space.reader(Topic("out0", "HelloWorld"), Qos(reliable=False), note)

        def program(part: Part) -> None:
            def blink() -> Generator[float]:
                while True:
                    part.publish("out", HelloWorld(index=1, message="x"))
                    done.append("blinks")
                    yield 0.05

            part.on_join(lambda: part.start(blink))
            part.safe_state(lambda: done.append("safe"))
            part.on_go(lambda: done.append("goes on"))

        inventory, now = site.master.inventory, asyncio.get_running_loop().time
        async with site.part(0, await site.token("bob"), program=program):
            await site.until(lambda: len(heard) > 2)
            inventory.pupil_parts.pupils.freeze = Freeze("ada", "", now())
            inventory.pupil_parts.follow(now())
            told, steps = len(heard), len(done)
            await site.until(lambda: len(done) > steps + 5)
            assert len(heard) == told, "what it says while it is frozen reaches nobody"
            site.master.say_stop("ada")
            await site.until(lambda: not site.master.stop.silent)
            assert "safe" in done
            inventory.pupil_parts.pupils.freeze = None
            inventory.pupil_parts.follow(now())
            site.master.say_go("ada")
            await site.until(lambda: len(heard) > told + 2)
            after = done[done.index("safe") :]
            assert after[after.index("goes on") - 1] == "safe", "nothing is done between STOP and GO"
            assert after.count("goes on") == 1
            assert after[-1] == "blinks", "it goes on where it waited"
