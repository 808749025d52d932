"""The load forecast of a blueprint, against the simulated bus in virtual time."""

from __future__ import annotations

import asyncio
from pathlib import Path
from random import Random

import pytest

from msbot.config import Blueprint, Library, load_blueprint, load_library, write_sample
from msbot.pnp import forecast
from msbot.process.virtual_time import run_virtual
from msbot.registry import open_registry
from msbot_agent.link.can.protocol import Framing
from msbot_school.demo import DemoLinkKind, DemoRobot
from msbot_xrce import compress

SETTLED_S = 5.0
MEASURED_S = 60.0


def sample(folder: Path, changes: dict[str, str]) -> tuple[Blueprint, Library]:
    path = folder / "robot.toml"
    write_sample(path)
    text = path.read_text()
    for before, after in changes.items():
        assert before in text
        text = text.replace(before, after)
    path.write_text(text)
    library = load_library()
    return load_blueprint(path, library), library


def measured_load(
    folder: Path, blueprint: Blueprint, library: Library, wire: DemoLinkKind, bitrate: int, *, compression: bool
) -> float:
    """Busy part of a minute of the sample robot on the simulated bus."""

    async def main() -> float:
        with open_registry(folder / "robot.db") as registry:
            robot = DemoRobot(
                blueprint,
                registry.runs.begin(registry.robots.apply_blueprint(blueprint, library)),
                wire=wire,
                bitrate=bitrate,
                random=Random(7),
                epoch_ns=lambda: 0,
                compression=compression,
            )
            driver = robot._wiring.driver
            assert driver is not None
            async with asyncio.TaskGroup() as tasks:
                running = tasks.create_task(robot.run())
                await asyncio.sleep(SETTLED_S)
                before = driver.counters.busy_s
                await asyncio.sleep(MEASURED_S)
                busy_s = driver.counters.busy_s - before
                robot.finish()
                await running
            return busy_s / MEASURED_S

    return run_virtual(main())


@pytest.mark.parametrize(
    ("wire", "bitrate", "compression", "changes"),
    [
        (DemoLinkKind.CAN, 500_000, True, {}),
        (DemoLinkKind.CAN, 500_000, False, {}),
        (DemoLinkKind.CAN, 125_000, True, {}),
        (DemoLinkKind.FD, 500_000, True, {}),
        (DemoLinkKind.CAN, 500_000, True, {"reliable = true": "reliable = false"}),
        (DemoLinkKind.CAN, 500_000, True, {'"thesis"  ': '"fast"  '}),
        (DemoLinkKind.CAN, 500_000, False, {'to = ["BB.in"]': 'to = ["BB.in", "CC.in"]', 'to = ["CC.in"]': "to = []"}),
    ],
)
def test_the_forecast_agrees_with_the_simulated_bus_within_2_percent(
    wire: DemoLinkKind, bitrate: int, compression: bool, changes: dict[str, str], tmp_path: Path
) -> None:
    blueprint, library = sample(tmp_path, changes)
    fd = wire is DemoLinkKind.FD
    framing = Framing(fd, fd, compress if compression else None)
    foreseen = forecast(blueprint, library, framing).load(bitrate, 2_000_000 if fd else None)
    measured = measured_load(tmp_path, blueprint, library, wire, bitrate, compression=compression)
    assert foreseen == pytest.approx(measured, rel=0.02)


def foresee(tmp_path: Path, changes: dict[str, str], **sizes: int) -> tuple[list[tuple[str, str, str]], float]:
    blueprint, library = sample(tmp_path, changes)
    found = forecast(blueprint, library, Framing(compress=compress), sizes=sizes)
    return [(flow.group, flow.what, flow.slot) for flow in found.flows], found.load(500_000)


def test_every_flow_is_named(tmp_path: Path) -> None:
    flows, _ = foresee(
        tmp_path, {'from = "CC.out"\nto = ["AA.in"]': 'from = "CC.out"\nto = ["AA.in"]\nreliable = false'}
    )
    assert flows[:5] == [
        ("BEACON", "the master is here", ""),
        ("beats", "beat", "AA"),
        ("beats", "answer", "AA"),
        ("beats", "beat", "BB"),
        ("beats", "answer", "BB"),
    ]
    assert flows[7:11] == [
        ("HelloWorldTopic_1_to_2", "sample", "AA"),
        ("HelloWorldTopic_1_to_2", "acknowledgement", "AA"),
        ("HelloWorldTopic_1_to_2", "delivery", "BB"),
        ("HelloWorldTopic_1_to_2", "acknowledgement", "BB"),
    ]
    assert flows[15:] == [("HelloWorldTopic_3_to_1", "sample", "CC"), ("HelloWorldTopic_3_to_1", "delivery", "AA")]


LIGHT = """
number = "LITE"
name = "Light"
[[port]]
name = "out"
direction = "publish"
type = "LightLevel"
rate_hz = {rate}
[[port]]
name = "in"
direction = "subscribe"
type = "LightLevel"
[[type]]
name = "LightLevel"
fields = {{ words = "text" }}
"""


def light_robot(tmp_path: Path, rate: float, parts: int = 2) -> tuple[Blueprint, Library]:
    folder = tmp_path / "library"
    folder.mkdir(exist_ok=True)
    (folder / "LITE.toml").write_text(LIGHT.format(rate=rate))
    slots = "".join(f'[[slot]]\nname = "L{number}"\npart = "LITE"\n' for number in range(parts))
    path = tmp_path / "light.toml"
    path.write_text(
        '[robot]\nname = "R"\nversion = "1"\nserial_number = "2"\nreleased = "3"\nmanufacturer = "4"\n'
        f'{slots}[[binding]]\ntopic = "light"\ntype = "LightLevel"\nfrom = "L0.out"\nto = ["L1.in"]\nreliable = false\n'
    )
    library = load_library(folder)
    return load_blueprint(path, library), library


def test_samples_of_unknown_types_have_8_bytes_unless_told_otherwise(tmp_path: Path) -> None:
    blueprint, library = light_robot(tmp_path, 50)
    framing = Framing(compress=compress)
    found = forecast(blueprint, library, framing)
    assert found.assumed == {"LightLevel": 8}
    assert [flow.cost.frames for flow in found.flows if flow.group == "light"] == [2, 2]
    small = forecast(blueprint, library, framing, sizes={"LightLevel": 4})
    assert small.assumed == {}
    assert [flow.cost.frames for flow in small.flows if flow.group == "light"] == [1, 1]
    # A beat and a sample of 4 bytes, each with its answer or delivery, are much alike.
    by_group = {group: sum(flow.rate_hz for flow in small.flows if flow.group == group) for group in ("light", "beats")}
    assert by_group == {"light": 100, "beats": 4}


def test_ports_without_a_rate_are_left_out_and_named(tmp_path: Path) -> None:
    blueprint, library = light_robot(tmp_path, 0)
    found = forecast(blueprint, library, Framing(compress=compress))
    assert found.on_event == ("light",)
    assert not [flow for flow in found.flows if flow.group == "light"]


def test_twice_the_bit_rate_is_half_the_load_and_more_parts_more_of_it(tmp_path: Path) -> None:
    blueprint, library = light_robot(tmp_path, 10, parts=2)
    found = forecast(blueprint, library, Framing(compress=compress))
    assert found.load(250_000) == pytest.approx(2 * found.load(500_000))
    blueprint, library = light_robot(tmp_path, 10, parts=120)
    many = forecast(blueprint, library, Framing(compress=compress))
    assert many.load(500_000) > found.load(500_000) + 110 * 230 / 500_000


def test_the_sizes_of_messages_without_texts_are_known_from_the_library(tmp_path: Path) -> None:
    (tmp_path / "cart.toml").write_text(
        '[robot]\nname = "R"\nversion = "1"\nserial_number = "2"\nreleased = "3"\nmanufacturer = "4"\n'
        '[[slot]]\nname = "knob"\npart = "POT-10K"\n[[slot]]\nname = "motors"\npart = "L298N"\n'
        '[[binding]]\ntopic = "power"\ntype = "Level"\nfrom = "knob.level"\nto = ["motors.left"]\n'
    )
    library = load_library()
    found = forecast(load_blueprint(tmp_path / "cart.toml", library), library, Framing(compress=compress))
    assert found.assumed == {}
    told = forecast(
        load_blueprint(tmp_path / "cart.toml", library), library, Framing(compress=compress), sizes={"Level": 64}
    )
    assert told.load(500_000) > found.load(500_000)
