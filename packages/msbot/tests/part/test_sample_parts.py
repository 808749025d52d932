"""The thesis' ring: AA switches BB's outputs, BB tells pin 3, CC tells a number, each to the next."""

import asyncio
from random import Random

import pytest

from msbot.part.boards.gpio import PinDirection, SimGpio
from msbot.part.join.joining import JoinState
from msbot.part.sample_parts import SAMPLE_PARTS, make_sample, pin_in
from msbot.process.virtual_time import run_virtual
from msbot_xrce.errors import ConfigError
from tests.part.wire import QuietLink, SmallMaster, publishes, subscribes

RING = {
    "ABCD": [publishes("out", "HelloWorldTopic_1_to_2"), subscribes("in", "HelloWorldTopic_3_to_1")],
    "EFGH": [publishes("out", "HelloWorldTopic_2_to_3"), subscribes("in", "HelloWorldTopic_1_to_2")],
    "WXYZ": [publishes("out", "HelloWorldTopic_3_to_1"), subscribes("in", "HelloWorldTopic_2_to_3")],
}


def listen(link: QuietLink) -> list[str]:
    """The texts that a part says on its link."""
    said: list[str] = []

    def tap(_now: float, way: str, _peer: object, packet: bytes) -> None:
        start = packet.find(b"Publisher ")
        if way == "out" and start > 0:
            said.append(packet[start : packet.index(0, start)].decode())

    link.tap = tap
    return said


def test_the_number_of_the_output_is_the_character_with_index_23() -> None:
    for pin in range(8):
        assert pin_in(f"Publisher A(1) turn-on {pin}") == pin
    for text in ("Publisher A(1) turn-on 8", "Publisher A(1) turn-on x", "Publisher A(1) turn-on ", "", "²" * 30):
        assert pin_in(text) is None


def test_they_have_the_numbers_and_names_of_the_thesis() -> None:
    assert {name: sample.part_number for name, sample in SAMPLE_PARTS.items()} == {
        "AA": "ABCD",
        "BB": "EFGH",
        "CC": "WXYZ",
    }
    part = make_sample("AA", uid=b"12345678")
    assert (part.part_number, part.local_name, part.uid) == ("ABCD", "ABCD-local", b"12345678")
    assert part.robot.name == "MSBOT_MASTER"
    with pytest.raises(ConfigError, match="no sample part 'DD': choose AA, BB, CC"):
        make_sample("DD")


def test_the_ring_turns_and_a_lost_master_leaves_all_outputs_off() -> None:
    board = SimGpio()

    async def main() -> None:
        master = SmallMaster(RING)
        master.start()
        loop = asyncio.get_running_loop()
        parts = {
            name: make_sample(name, random=Random(name), board=board if name == "BB" else None) for name in SAMPLE_PARTS
        }
        links = [master.link() for _ in parts]
        tasks = [loop.create_task(part.run_async(link)) for part, link in zip(parts.values(), links, strict=True)]
        said = [listen(link) for link in links]
        on: list[int] = []
        board.on_change(lambda pin, level: on.append(pin) if level else None)
        # What AA says in the moment in which BB is not active yet is lost; from its second word on it is obeyed.
        await asyncio.sleep(0.5)
        for turn in range(8):
            await asyncio.sleep(1.0)
            assert sum(board.levels()) == 1, turn
        assert all(board.direction(pin) is PinDirection.OUTPUT for pin in range(8))
        assert len(set(on)) > 1
        for part in parts.values():
            assert part.state is JoinState.ACTIVE
            assert part.counters.messages_out == 9
            assert part.counters.messages_in >= 8
            assert part.counters.handler_errors == 0
        texts = [sorted({text[:-1] for text in one}) for one in said]
        assert texts == [
            ["Publisher A(1) turn-on "],
            ["Publisher B(2) gpio-3 = "],
            ["Publisher C(1) random value = "],
        ]
        await master.kill()
        await asyncio.sleep(5.0)
        assert sum(board.levels()) == 0
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)

    run_virtual(main())
