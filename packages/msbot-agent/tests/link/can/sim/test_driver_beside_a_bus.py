"""The clockwork beside a bus that is moved by hand: whatever is done to both, the same happens at the same times."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from random import Random

import pytest

from msbot_agent.link.can.controller import BusState
from msbot_agent.link.can.protocol.frames import Frame
from msbot_agent.link.can.sim.model.events import Delivered, Sent
from msbot_agent.link.can.sim.model.sim_bus import SimBus
from msbot_agent.link.can.sim.sim_bus_driver import SimBusDriver, SimCanBus
from msbot_xrce.errors import LinkDown, LinkFull
from tests.effort import tries
from tests.link.can.sim.virtual import virtually

NAMES = ("A", "B", "C", "D")
Happened = tuple[object, ...]


class Both:
    """A driver, and a bus beside it."""

    def __init__(self) -> None:
        self.driver, self.bus = SimBusDriver(SimBus(500_000)), SimBus(500_000)
        self.told: list[Happened] = []
        """By the driver."""
        self.tapped: list[list[Happened]] = [[], []]
        self.happened: list[Happened] = []
        """On the bus."""
        self.ports: dict[str, SimCanBus] = {}
        self.nodes: dict[str, int] = {}
        self.driver.tap = lambda at, name, frame: self.tapped[0].append((at, name, frame))
        self.driver.listeners = [lambda at, name, frame: self.tapped[1].append((at, name, frame))]
        for name in NAMES:
            self.attach(name)

    def attach(self, name: str) -> None:
        port = self.ports[name] = self.driver.attach(name)
        node = self.nodes[name] = self.bus.attach(name)
        assert port.node == node
        told = self.told
        port.attach(frame=lambda frame, at: told.append((at, node, "heard", frame)))
        port.attach(sent=lambda frame, at: told.append((at, node, "sent", frame)))
        port.attach(room=lambda at: told.append((at, node, "room")))
        port.attach(state=lambda state, _words, at: told.append((at, node, "state", state)))

    def catch_up(self, now: float) -> None:
        for event in self.bus.advance(now):
            if isinstance(event, Delivered):
                self.happened += [(event.at, node, "heard", event.frame) for node in event.nodes]
            elif isinstance(event, Sent):
                self.happened += [(event.at, event.node, "sent", event.frame), (event.at, event.node, "room")]
            else:
                self.happened.append((event.at, event.node, "state", event.state))

    def send(self, name: str, frame: Frame, now: float) -> None:
        def tried(act: Callable[[], None]) -> str:
            try:
                act()
            except (LinkDown, LinkFull) as error:
                return type(error).__name__
            return ""

        port, node = self.ports[name], self.nodes[name]
        assert tried(lambda: port.send(frame)) == tried(lambda: self.bus.submit(node, frame, now))

    def remove(self, name: str, now: float) -> None:
        port = self.ports[name]
        if port.node % 2:
            self.driver.detach(name)
        else:
            self.driver.remove(port)
        self.driver.remove(port)
        self.bus.detach(self.nodes[name], now)
        assert (port.is_attached, port.pending(), port.has_room(), port.error_counters()) == (False, 0, False, (0, 0))
        with pytest.raises(LinkDown, match="was removed"):
            port.send(Frame(1))
        port.restart()
        self.attach(name)


Action = Callable[[float], None]


def actions(both: Both, name: str, random: Random) -> list[tuple[Action, Action]]:
    """For the driver, and for the bus beside it; sending is what happens most."""
    driver, bus, node, port = both.driver, both.bus, both.nodes[name], both.ports[name]
    frame = Frame(random.randrange(2048), random.randbytes(random.randrange(9)))
    is_broken = random.random() < 0.3
    every: list[tuple[Action, Action]] = [
        (lambda _: driver.unplug(name), lambda now: bus.unplug(node, now)),
        (lambda _: driver.plug(name), lambda now: bus.plug(node, now)),
        (lambda _: driver.short_circuit(), bus.short_circuit),
        (lambda _: driver.repair(), bus.repair),
        (lambda _: driver.repair(), bus.repair),
        (lambda _: port.restart(), lambda now: bus.restart(node, now)),
        (lambda now: both.remove(name, now), lambda _: None),
        (
            lambda _: driver.break_sender(name, broken=is_broken),
            lambda _: bus.break_sender(node, broken=is_broken),
        ),
        (lambda _: driver.break_sender("nobody", broken=True), lambda _: driver.detach("nobody")),
    ]
    return [*every, *([(lambda now: both.send(name, frame, now), lambda _: None)] * 20)]


@pytest.mark.parametrize("seed", range(tries(12, 500)))
@virtually
async def test_the_same_happens_at_the_same_times(seed: int) -> None:
    random, both, loop = Random(seed), Both(), asyncio.get_running_loop()
    for _ in range(150):
        await asyncio.sleep(random.choice((0.0, random.random() * 3e-4, random.random() * 3e-3)))
        now = loop.time()
        both.catch_up(now)
        name = random.choice(NAMES)
        for act in random.choice(actions(both, name, random)):
            act(now)
        assert both.driver.now() == now
        assert both.told == both.happened
        for name, port in both.ports.items():
            assert both.driver.is_plugged(name) == both.bus.is_plugged(port.node)
            assert port.pending() == both.bus.pending(port.node)
            assert port.error_counters() == both.bus.error_counters(port.node)
            is_off = both.bus.state(port.node) is BusState.OFF
            assert port.has_room() == (port.pending() < 3 and not is_off)
        assert both.driver.load() == both.bus.load(now)
    both.driver.repair()
    both.bus.repair(loop.time())
    await asyncio.sleep(0.1)
    both.catch_up(loop.time())
    assert both.told == both.happened
    sent = [(at, frame) for at, _, what, *rest in both.happened if what == "sent" for frame in rest]
    assert both.tapped[0] == both.tapped[1]
    assert [(at, frame) for at, _, frame in both.tapped[0]] == sent
    assert both.driver.counters == both.bus.counters


@virtually
async def test_a_controller_stays_on_the_bus_until_its_run_is_cancelled() -> None:
    driver = SimBusDriver(SimBus(500_000))
    port = driver.attach("A")
    running = asyncio.ensure_future(port.run())
    await asyncio.sleep(10.0)
    assert (running.done(), port.is_attached) == (False, True)
    running.cancel()
    await asyncio.wait([running])
    assert not port.is_attached
    driver.attach("A")
