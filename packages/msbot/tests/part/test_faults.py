"""Four parts that talk to each other while links lose packets, cables are cut and the master dies: all come back."""

import asyncio
from random import Random

import pytest

from msbot.part.join.joining import JoinState
from msbot.part.messages.standard import HelloWorld
from msbot.part.part import Part
from msbot.process.virtual_time import run_virtual
from msbot_agent.link import LossyLink
from tests.effort import tries
from tests.part.wire import QuietLink, SmallMaster, publishes, subscribes

NUMBERS = ("P1", "P2", "P3", "P4")
PERIOD_S = 0.25
"""How often each part speaks: to three that hear reliably, also while a quarter of all packets is lost."""
HEARD_S = 3.0


def make_part(number: str, random: Random) -> Part:
    part = Part(number, random=random)

    @part.every(PERIOD_S)
    def talk() -> None:
        part.publish("out", HelloWorld(index=0, message="x" * random.choice([1, 100, 3000])))

    @part.on("in", HelloWorld)
    def hear(message: HelloWorld) -> None:
        assert set(message.message) == {"x"}

    return part


async def trouble(master: SmallMaster, links: list[QuietLink], random: Random) -> None:
    """Half a minute of accidents."""
    for _ in range(8):
        await asyncio.sleep(random.uniform(0.2, 4.0))
        match random.randrange(4):
            case 0 | 1:
                await master.kill()
                await asyncio.sleep(random.uniform(0.0, 4.0))
                master.start()
            case 2:
                master.version += 1
            case 3:
                link = random.choice(links)
                link.cut = True
                await asyncio.sleep(random.uniform(0.0, 8.0))
                link.cut = False


@pytest.mark.parametrize("seed", range(tries(3, 60)))
def test_after_any_trouble_all_parts_are_active_and_hear_each_other(seed: int) -> None:
    async def main() -> None:
        random = Random(seed)
        loop = asyncio.get_running_loop()
        errors: list[dict[str, object]] = []
        loop.set_exception_handler(lambda _loop, context: errors.append(context))
        master = SmallMaster(
            {number: [publishes("out", "T"), subscribes("in", "T", reliable=number != "P1")] for number in NUMBERS}
        )
        master.start()
        parts = [make_part(number, Random(f"{seed} {number}")) for number in NUMBERS]
        links = [master.link() for _ in parts]
        spoiled = [
            LossyLink(
                link,
                random=Random(number),
                drop=random.choice([0.0, 0.1, 0.25]),
                duplicate=0.1,
                reorder=0.1,
                delay=random.choice([0.0, 0.01, 0.1]),
            )
            for number, link in enumerate(links)
        ]
        tasks = [loop.create_task(part.run_async(link)) for part, link in zip(parts, spoiled, strict=True)]
        await trouble(master, links, random)
        for link in spoiled:
            link.disturbance.drop = 0.0
        await asyncio.sleep(12.0)
        assert [part.state for part in parts] == [JoinState.ACTIVE] * 4
        heard = [part.counters.messages_in for part in parts]
        await asyncio.sleep(HEARD_S)
        least = len(NUMBERS) * HEARD_S / PERIOD_S / 2
        assert all(part.counters.messages_in > before + least for part, before in zip(parts, heard, strict=True))
        assert [part.counters.handler_errors for part in parts] == [0] * 4
        for part in parts:
            part.end()
        await asyncio.gather(*tasks)
        await master.kill()
        assert errors == []

    run_virtual(main())
