"""Relays of an agent: names, limits, a new address, and parts that are not believed more than others."""

import asyncio
from collections.abc import Awaitable, Callable

from msbot.process.virtual_time import run_virtual
from msbot_agent.agent import Agent, AgentSettings
from msbot_agent.agent.relays import MAX_RELAYS_OF_ADDRESS
from msbot_agent.link.relay import Bye, Hello, Refused, RelayedLink, Who, decode, encode
from msbot_agent.link.relay.relay_messages import MARK, Up, Welcome
from msbot_agent.space import MemorySpace
from tests.agent.wiring import FakeLink

LOGIN = bytes.fromhex("80000000 00010c00 58524345 01000f00 00000001 81000002".replace(" ", ""))


def hello(number: int, name: str = "pi", carried: str = "can:can0") -> bytes:
    return encode(Hello(number.to_bytes(8, "big"), name, carried, 512, 500_000, True, False))


def play(scene: Callable[[Agent, FakeLink], Awaitable[None]], settings: AgentSettings | None = None) -> None:
    """Run a scene with an agent that serves one link."""

    async def main() -> None:
        agent, link = Agent(MemorySpace(), settings=settings), FakeLink()
        agent.add_link(link)
        running = asyncio.get_running_loop().create_task(agent.run())
        await asyncio.sleep(0.01)
        await scene(agent, link)
        running.cancel()
        await asyncio.gather(running, return_exceptions=True)

    run_virtual(main())


def answers(link: FakeLink, peer: str) -> list[object]:
    return [decode(packet) for to, packet in link.sent if to == peer and packet.startswith(MARK)]


def relays(agent: Agent) -> list[RelayedLink]:
    return [link for link in agent.links if isinstance(link, RelayedLink)]


def test_a_relay_whose_name_is_taken_is_told_so_and_the_first_stays() -> None:
    async def scene(agent: Agent, link: FakeLink) -> None:
        link.inject(hello(1), "one")
        link.inject(hello(2), "two")
        assert [type(answer) for answer in answers(link, "one")] == [Welcome]
        assert answers(link, "two") == [
            Refused("a relay with the name pi is there already, at peer one: give this one another with --name")
        ]
        link.inject(hello(2, "other"), "two")
        assert [one.hello.name for one in relays(agent)] == ["pi", "other"]
        await asyncio.sleep(5)  # both are silent: the name is free
        link.inject(hello(3), "three")
        assert [type(answer) for answer in answers(link, "three")] == [Welcome]
        await asyncio.sleep(0.1)
        assert [(one.hello.name, one.relay) for one in relays(agent)] == [("other", "two"), ("pi", "three")]

    play(scene)


def test_a_relay_that_comes_from_a_new_address_is_the_same_one() -> None:
    async def scene(agent: Agent, link: FakeLink) -> None:
        link.inject(hello(1), "one")
        link.inject(hello(1), "elsewhere")
        assert len(relays(agent)) == 1
        link.inject(encode(Up(1, "CAN node 1", LOGIN)), "one")
        assert answers(link, "one")[1:] == [Who()]
        link.inject(encode(Up(1, "CAN node 1", LOGIN)), "elsewhere")
        await asyncio.sleep(0.1)
        assert [client.address for client in agent.clients()] == ["CAN node 1 behind relay pi"]

    play(scene)


def test_an_address_has_so_many_relays_and_one_that_brought_nobody_makes_room() -> None:
    async def scene(agent: Agent, link: FakeLink) -> None:
        for number in range(1, 4 * MAX_RELAYS_OF_ADDRESS):
            link.inject(hello(number, f"pi{number}"), "one")
            await asyncio.sleep(0.01)
        assert len(relays(agent)) <= MAX_RELAYS_OF_ADDRESS

    play(scene)


def test_a_relay_that_says_goodbye_or_is_silent_for_a_minute_is_forgotten() -> None:
    async def scene(agent: Agent, link: FakeLink) -> None:
        link.inject(hello(1), "one")
        link.inject(hello(2, "other"), "two")
        await asyncio.sleep(0.1)
        link.inject(encode(Bye()), "one")
        await asyncio.sleep(0.1)
        assert [one.hello.name for one in relays(agent)] == ["other"]
        await asyncio.sleep(62)
        assert relays(agent) == []

    play(scene)


def test_octets_that_begin_like_a_relay_and_are_none_are_counted() -> None:
    async def scene(agent: Agent, link: FakeLink) -> None:
        for octets in (MARK, MARK + b"\x01", MARK + b"\xfe", hello(1)[:-4]):
            link.inject(octets + b"\0" * (4 - len(octets)), "rude")
        assert agent.dropped() == {"message of a relay that cannot be read": 4}
        link.inject(encode(Up(1, "", b"x")), "rude")
        assert answers(link, "rude") == [Who()]

    play(scene)
