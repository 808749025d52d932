"""What is wrong at the start is said in one clear sentence."""

from __future__ import annotations

import re
import shutil
import socket
import subprocess
from pathlib import Path

import pytest

from msbot_agent.space import parse_space
from msbot_agent.space.dds import DdsSpace, libddsc
from msbot_agent.space.dds.dds_network import NetworkInterface, choose
from msbot_xrce.errors import ConfigError
from tests.space.dds.foreign_programs import refuse


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("dds:233", "'dds:233': DDS domains go from 0 to 232, those above have no UDP ports"),
        ("dds:x", "'dds:x': the domain is a number from 0 to 232"),
        ("dds:", "'dds:': the domain is a number from 0 to 232"),
        ("dds:-1", "'dds:-1': the domain is a number from 0 to 232"),
        (
            "dss",
            "'dss' is not a data space: memory, dds, dds:DOMAIN or zenoh:tcp/HOST:PORT is needed, for example dds:5",
        ),
        (
            "memory:3",
            "'memory:3' is not a data space: memory, dds, dds:DOMAIN or zenoh:tcp/HOST:PORT is needed, for example "
            "dds:5",
        ),
        ("dds?interfaces=lo", "'dds?interfaces=lo': dds has one option, interface, for example dds:5?interface=eth0"),
        ("dds?interface=", "'dds?interface=': dds has one option, interface, for example dds:5?interface=eth0"),
    ],
)
def test_a_wrong_address_is_told(text: str, words: str) -> None:
    with pytest.raises(ConfigError, match=re.escape(words)):
        parse_space(text)


async def test_no_libddsc(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("CYCLONEDDS_HOME", str(tmp_path))
    words = (
        f"DDS: CYCLONEDDS_HOME is {tmp_path}, and there is no libddsc in its lib folder: pip install 'msbot-agent[dds]'"
    )
    with pytest.raises(ConfigError, match=re.escape(words)):
        DdsSpace()
    monkeypatch.delenv("CYCLONEDDS_HOME")
    monkeypatch.setattr(libddsc, "places", lambda: iter(()))
    with pytest.raises(ConfigError, match=r"DDS needs libddsc, the library of Cyclone DDS, and it is not here: pip"):
        DdsSpace()


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("libddsc.so.0.9.1", "cannot be loaded (it is version 0.9)"),
        ("libddsc.so.12.0.0", "cannot be loaded (it is version 12.0)"),
        ("libddsc.so", "is of a version that MsBOT does not know (it lacks dds_create_domain)"),
    ],
)
async def test_a_libddsc_of_another_version(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, name: str, words: str
) -> None:
    if shutil.which("gcc") is None:
        refuse("gcc is not installed")
    (tmp_path / "lib").mkdir()
    source = tmp_path / "empty.c"
    source.write_text("int nothing;\n")
    subprocess.run(["gcc", "-shared", "-o", tmp_path / "lib" / name, source], check=True)  # noqa: ASYNC221
    monkeypatch.setenv("CYCLONEDDS_HOME", str(tmp_path))
    with pytest.raises(ConfigError, match=re.escape(words)) as caught:
        DdsSpace()
    assert "versions 0.10 to 11 will do" in str(caught.value)


async def test_a_file_that_is_no_library(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    (tmp_path / "lib").mkdir()
    (tmp_path / "lib/libddsc.so").write_text("nonsense")
    monkeypatch.setenv("CYCLONEDDS_HOME", str(tmp_path))
    with pytest.raises(ConfigError, match="cannot be loaded"):
        DdsSpace()


async def test_the_domains_ports_are_taken() -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as multicast:
        multicast.bind(("0.0.0.0", 7400 + 250 * 3))  # without sharing, as no DDS program does
        with pytest.raises(
            ConfigError, match=r"DDS domain 3 cannot be joined \(.*\): its UDP ports, from 8150 on, are"
        ):
            DdsSpace(3)
    with DdsSpace(3) as space:
        assert space.words is not None


async def test_a_busy_port_of_one_participant_is_no_trouble() -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as unicast:
        unicast.bind(("0.0.0.0", 7410))
        with DdsSpace():
            pass


async def test_no_interface_at_all() -> None:
    subprocess.run(["ip", "link", "set", "lo", "down"], check=True)  # noqa: ASYNC221
    with pytest.raises(ConfigError, match=r"DDS domain 0 cannot be joined .* or no network interface is up"):
        DdsSpace()
    with pytest.raises(ConfigError, match="the network interface lo is down or has no IPv4 address: `ip addr show lo`"):
        DdsSpace(interface="lo")


def test_the_network_is_chosen_by_what_there_is(monkeypatch: pytest.MonkeyPatch) -> None:
    lo = NetworkInterface("lo", is_up=True, is_loopback=True, multicast=False, address="10.0.0.7")
    eth = NetworkInterface("eth0", is_up=True, is_loopback=False, multicast=True, address="10.0.0.7")
    ppp = NetworkInterface("ppp0", is_up=True, is_loopback=False, multicast=False, address="10.0.0.7")
    down = NetworkInterface("eth1", is_up=False, is_loopback=False, multicast=True, address="10.0.0.7")
    bare = NetworkInterface("eth2", is_up=True, is_loopback=False, multicast=True)
    assert choose(None, [lo, eth]).words == "the network"
    assert choose(None, [lo, eth]).config is None
    alone = choose(None, [lo, down, bare])
    assert alone.words == "this computer only: it has no network"
    assert alone.config is not None
    assert '<NetworkInterface name="lo" multicast="true"/>' in alone.config
    assert "<Peer" in alone.config
    assert choose(None, [lo, ppp]).words == (
        "ppp0, without multicast: peers elsewhere are found only if CYCLONEDDS_URI names them"
    )
    assert choose("eth0", [lo, eth]).config == (
        '<General><Interfaces><NetworkInterface name="eth0"/></Interfaces></General>'
    )
    assert choose(None, []).config is None  # where interfaces cannot be told
    monkeypatch.setenv("CYCLONEDDS_URI", "<General/>")
    assert choose("eth0", [lo]).words == "as CYCLONEDDS_URI says"


async def test_a_library_that_changes_samples_is_not_used(monkeypatch: pytest.MonkeyPatch) -> None:
    from msbot_agent.space.dds.raw_type import Serialiser

    genuine = Serialiser.take
    monkeypatch.setattr(
        Serialiser, "take", lambda self, reader, most=64: [(1, body + b"x") for _, body in genuine(self, reader) or ()]
    )
    with pytest.raises(ConfigError, match="does not pass samples through as they are: another version will do"):
        DdsSpace()
