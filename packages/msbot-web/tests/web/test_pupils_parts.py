"""Pupils' programs at a running robot, over real WebSockets: held at the gate, STOP is heard all the same."""

from __future__ import annotations

import asyncio

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
