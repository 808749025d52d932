"""The figures for Prometheus: what is counted, how it is written, and that it is read in the robot's own loop."""

from __future__ import annotations

import asyncio
import json
import re
import socket
import subprocess
import sys
import threading
from collections.abc import Callable
from types import SimpleNamespace
from typing import cast
from unittest.mock import patch
from urllib.request import urlopen

import pytest

from msbot.master import Master
from msbot.metrics import (
    AgentFigures,
    Buckets,
    DatabaseFigures,
    MetricsCollector,
    MetricsSampler,
    MetricsServer,
    MomentFigures,
    PageFigures,
    RobotFigures,
)
from msbot.metrics.figures import BusLoad, LinkFigures, meter_of
from msbot.metrics.metrics_server import exposition
from msbot_agent.agent import Agent
from msbot_agent.link import Link, LinkInfo
from msbot_agent.link.can import CanBusInfo
from msbot_agent.link.can.protocol import Frame, wire_bits
from msbot_agent.link.net import UdpServerLink
from msbot_agent.space import MemorySpace
from msbot_xrce.errors import ConfigError
from msbot_xrce.messages import CreateClient, Header, encode_message
from tests import ROOT

prometheus = pytest.importorskip("prometheus_client", reason="pip install 'msbot[metrics]'")

FIGURES = MomentFigures(
    agent=AgentFigures(
        (LinkFigures("sim", 3, 100, 90, 4000, 3000, {"a 'strange'\n\"reason\"": 4}),),
        {"no session": 2},
        (("light", 30, 29),),
    ),
    robot=RobotFigures("Rover", {"active": 2, "late": 0}, 3, stopped=True),
    database=DatabaseFigures(1, 2, is_well=False),
    page=PageFigures(5, 6, "sim0", 0.25, 500_000),
    tasks=12,
    beats=77,
    beat_intervals=Buckets((0.5, 1.0)).read(),
    loop_delays=Buckets((0.1,)).read(),
    latencies=Buckets((0.001,)).read(),
    acknowledgements=Buckets((0.001,)).read(),
)


def values(text: bytes) -> dict[tuple[str, tuple[str, ...]], float]:
    """`(name, values of its labels) -> value`, as Prometheus reads it."""
    from prometheus_client.parser import text_string_to_metric_families

    return {
        (sample.name, tuple(sample.labels[label] for label in sorted(sample.labels))): sample.value
        for family in text_string_to_metric_families(text.decode())
        for sample in family.samples
    }


def test_everything_is_written_as_prometheus_reads_it() -> None:
    text, kind = exposition(lambda: FIGURES)
    assert kind.startswith("text/plain")
    found = values(text)
    assert found["msbot_sessions", ("sim",)] == 3
    assert found["msbot_link_packets_total", ("in", "sim")] == 100
    assert found["msbot_link_octets_total", ("out", "sim")] == 3000
    assert found["msbot_link_lost_total", ("sim", "a 'strange'\n\"reason\"")] == 4, "nothing breaks out of its line"
    assert found["msbot_agent_lost_total", ("no session",)] == 2
    assert found["msbot_topic_published_total", ("light",)] == 30
    assert found["msbot_parts", ("active",)] == 2
    assert found["msbot_loop_tasks", ()] == 12
    assert found["msbot_stopped", ()] == 1
    assert found["msbot_beats_total", ()] == 77
    assert found["msbot_database_well", ()] == 0
    assert found["msbot_bus_load_ratio", ("sim0",)] == 0.25


async def test_the_bus_is_measured_without_a_page() -> None:
    class Bus:
        """A CAN link, as far as a meter sees it."""

        info = LinkInfo("can0", 8, bits_per_second=1000)
        bus_info = CanBusInfo("can0", 1000)

        def on_frame(self, tap: Callable[[float, str, Frame], None]) -> None:
            self.tap = tap

    now = [10.0]
    bus, other = Bus(), UdpServerLink("127.0.0.1", 0)
    assert meter_of([other], lambda: now[0]) is None
    with patch("msbot.metrics.figures.CanEnd", Bus):
        meter = meter_of([cast("Link", bus), other], lambda: now[0])
    assert meter is not None
    frame = Frame(0x101, bytes(8))
    bus.tap(9.5, "here", frame)
    figures = MetricsCollector(Agent(MemorySpace()), bus=meter)()
    found = values(exposition(lambda: figures)[0])
    assert found["msbot_bus_load_ratio", ("can0",)] == pytest.approx(len(wire_bits(frame)) / 1000)
    assert found["msbot_bus_bitrate", ("can0",)] == 1000
    now[0] = 10.6
    assert MetricsCollector(Agent(MemorySpace()), bus=meter)().bus == BusLoad("can0", 0.0, 1000)


def test_the_page_names_every_figure_and_no_other() -> None:
    told = set(re.findall(r"`(msbot_\w+)`", (ROOT / "docs/howto/metrics.md").read_text()))
    names = {name for name, _ in values(exposition(lambda: FIGURES)[0]) if name.startswith("msbot_")}
    histograms = {re.sub("_(bucket|count|sum)$", "", name) for name in names}
    assert histograms - {"msbot_robot_info"} == told


def test_the_dashboard_is_what_its_tool_writes_and_asks_only_for_what_there_is() -> None:
    pytest.importorskip("grafana_foundation_sdk", reason="it checks the form of the dashboard")
    from grafana_foundation_sdk.models.dashboard import Dashboard

    sys.path.insert(0, str(ROOT / "tools"))
    try:
        import grafana_dashboard  # type: ignore[import-not-found, unused-ignore]
    finally:
        sys.path.pop(0)
    text = (ROOT / "examples/grafana/msbot.json").read_text()
    assert text == grafana_dashboard.build(), "python tools/grafana_dashboard.py"
    board = Dashboard.from_json(json.loads(text))
    assert board.title == "MsBOT"
    asked = set(re.findall(r"\b((?:msbot|process)_\w+)", text)) - {"msbot_"}
    names = {name for name, _ in values(exposition(lambda: FIGURES)[0])}
    processes = {"process_resident_memory_bytes", "process_cpu_seconds_total"}
    assert asked - names - processes == set()
    assert len(board.panels or []) == 19


def test_buckets_count_what_is_at_most_their_bound() -> None:
    buckets = Buckets((1.0, 2.0))
    for value in (0.5, 1.0, 1.5, 7.0):
        buckets.add(value)
    buckets.add(2.0, times=2)
    found = buckets.read()
    assert found.rising == (("1.0", 2.0), ("2.0", 5.0), ("+Inf", 6.0))
    assert found.total == 14.0


class Inventory:
    """Parts with their beats."""

    def __init__(self) -> None:
        self.infos: list[SimpleNamespace] = []

    def view(self, _now: float) -> list[SimpleNamespace]:
        return self.infos


def test_intervals_between_beats_are_noted_also_when_several_came_since_the_last_look() -> None:
    inventory = Inventory()
    noting = MetricsSampler(Agent(MemorySpace()), cast("Master", SimpleNamespace(inventory=inventory)))

    def look(now: float, beats: int, last_at: float) -> None:
        inventory.infos = [SimpleNamespace(beat_age_s=now - last_at, beats=beats, client_key=1)]
        noting.sample(now)

    look(10.0, 5, 9.5)
    assert noting.beats == 0, "those before the first look are not ours"
    look(11.0, 6, 10.5)
    look(13.0, 8, 12.8)
    assert noting.beats == 3
    found = dict(noting.intervals.read().rising)
    assert found["0.8"] == 0
    assert found["1.0"] == 1
    assert found["1.2"] == 3, "two beats in 2.3 s"
    inventory.infos = []
    noting.sample(14.0)
    look(15.0, 1, 14.9)
    assert noting.beats == 3, "a part that comes anew begins anew"


async def test_an_agent_is_read_without_looking_at_each_of_its_sessions() -> None:
    agent = Agent(MemorySpace(clock=asyncio.get_running_loop().time))
    figures = MetricsCollector(agent)()
    assert figures == MomentFigures(agent=AgentFigures((), {}, ()), tasks=1)


async def test_two_links_with_any_free_port_are_told_apart_and_each_has_its_sessions() -> None:
    agent = Agent(MemorySpace(clock=asyncio.get_running_loop().time))
    links = [UdpServerLink("127.0.0.1", 0) for _ in range(2)]
    for link in links:
        agent.add_link(link)
    async with asyncio.timeout(30):
        task = asyncio.create_task(agent.run())
        while not all(link.port for link in links):  # noqa: ASYNC110 - the agent has the signal handlers
            await asyncio.sleep(0)
        one, two = (link.port for link in links)
        login = encode_message(Header(0x80, 0, 0), [CreateClient(0xAABBCCDD, 0x81, 512)], pad_end=False)
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as client:
            client.setblocking(False)
            client.connect(("127.0.0.1", two))
            client.send(login)
            await asyncio.get_running_loop().sock_recv(client, 1000)
        figures = MetricsCollector(agent)().agent
        task.cancel()
        await asyncio.wait([task])
    assert figures is not None
    assert {link.name: link.sessions for link in figures.links} == {
        f"udp:127.0.0.1:{one}": 0,
        f"udp:127.0.0.1:{two}": 1,
    }


async def fetch(address: str) -> bytes:
    """What a scraper gets."""
    return await asyncio.to_thread(lambda: bytes(urlopen(address, timeout=10).read()))


async def serving(read: Callable[[], MomentFigures]) -> tuple[MetricsServer, asyncio.Task[None]]:
    server = MetricsServer(read, MetricsSampler(Agent(MemorySpace()), None), 0)
    return server, asyncio.create_task(server.run())


async def test_figures_are_read_in_the_loop_whatever_thread_asks() -> None:
    threads: list[str] = []

    def read() -> MomentFigures:
        threads.append(threading.current_thread().name)
        return FIGURES

    server, task = await serving(read)
    text = await fetch(server.address)
    task.cancel()
    await asyncio.wait([task])
    assert values(text)["msbot_beats_total", ()] == 77
    assert threads == [threading.main_thread().name]


async def test_a_port_that_is_taken_is_one_sentence() -> None:
    server, task = await serving(lambda: FIGURES)
    port = int(server.address.split(":")[2].partition("/")[0])
    with pytest.raises(ConfigError, match=f"port {port} .* choose another one with --metrics"):
        MetricsServer(lambda: FIGURES, MetricsSampler(Agent(MemorySpace()), None), port)
    task.cancel()
    await asyncio.wait([task])


def test_without_the_package_the_remedy_is_said(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "prometheus_client", None)
    with pytest.raises(ConfigError, match=r"pip install 'msbot\[metrics\]'"):
        exposition(lambda: FIGURES)


def test_an_agent_without_database_and_recorder_serves_figures() -> None:
    """`msbot[metrics]` is enough for `msbot agent --metrics`: the extras of a master are not needed."""
    absent = "import sys; sys.modules.update(dict.fromkeys(('sqlalchemy', 'alembic', 'mcap', 'mcap_ros2')))"
    wanted = "from msbot.cli.run.master_services import AGENT_METRICS; print(AGENT_METRICS.options[0].__name__)"
    done = subprocess.run([sys.executable, "-c", f"{absent}\n{wanted}"], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
