"""`msbot bus send`: frames on a live bus."""

from __future__ import annotations

import pytest

from msbot.cli.bus import send as bus_send
from msbot_agent.link.can.adapters.python_can import frame_of
from msbot_agent.link.can.protocol.notation import format_frame
from msbot_agent.link.can.sim.python_can_interface import MsbotBus
from msbot_xrce.errors import ConfigError, LinkDown
from tests.cli.live_bus import bus, invoke, runtime_folder

__all__ = ["bus", "runtime_folder"]


def heard(bus: MsbotBus, count: int) -> list[str]:
    frames = []
    for _ in range(count):
        message = bus.recv(20.0)
        assert message is not None
        frames.append(format_frame(frame_of(message)))
    assert bus.recv(0) is None
    return frames


def test_frames_are_sent_and_acknowledged(bus: MsbotBus) -> None:
    assert invoke("send", "sim:bench1", "123#DEADBEEF", "1ABCDEF0#11.22", "7FF#R4").output == ""
    assert sorted(heard(bus, 3)) == ["123#DEADBEEF", "1ABCDEF0#1122", "7FF#R4"]


def test_frames_are_repeated(bus: MsbotBus) -> None:
    invoke("send", "sim:bench1", "123#01", "--repeat", "5", "--period", "0.001")
    assert heard(bus, 5) == ["123#01"] * 5


def test_when_nobody_acknowledges_it_is_said(bus: MsbotBus, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(bus_send, "PATIENCE_S", 0.05)
    bus.shutdown()
    with MsbotBus("bench1", listen_only=True), pytest.raises(LinkDown, match="nobody on sim:bench1 acknowledges"):
        invoke("send", "sim:bench1", "123#01")


def test_can_fd_needs_a_bus_that_bears_it(bus: MsbotBus) -> None:
    with pytest.raises(ConfigError, match=r"123##1DE is a CAN FD frame, and sim:bench1 is classic CAN"):
        invoke("send", "sim:bench1", "123##1DE")
    with MsbotBus("bench2", fd=True) as fast:
        invoke("send", "sim:bench2", "123##1DE")
        assert heard(fast, 1) == ["123##1DE"]


@pytest.mark.parametrize(
    ("frame", "words"), [("123", "is no CAN frame"), ("20000004#0008000000000000", "error report")]
)
def test_what_cannot_be_sent_is_said(bus: MsbotBus, frame: str, words: str) -> None:
    with pytest.raises(ConfigError, match=words):
        invoke("send", "sim:bench1", frame)


def test_a_missing_bus_is_said() -> None:
    with pytest.raises(LinkDown, match="there is no simulated bus 'bench1'"):
        invoke("send", "sim:bench1", "123#01")
