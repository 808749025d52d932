"""Whatever strangers send, the robot's log stays short: libraries' lines are bounded like its own."""

from __future__ import annotations

import socket
from contextlib import ExitStack
from pathlib import Path

import httpx

from msbot_agent.log import SAME
from tests.hostile.robot import Robot

GARBAGE = (
    b"\x16\x03\x01 this is no TLS either\r\n\r\n",
    b"GET\r\n\r\n",
    b"\x00" * 40,
    b"GET / HTTP/9.9\r\n\r\n",
    b"GET / HTTP/1.1\r\nHost: x\r\nUpgrade: websocket\r\nConnection: upgrade\r\n\r\n",
)
TIMES = 40


def test_requests_that_are_none_are_told_a_few_times_and_then_counted(tmp_path: Path) -> None:
    with ExitStack() as stack:
        robot = Robot(tmp_path, stack)
        master = robot.master(page=True)
        port = httpx.URL(robot.page).port or 0
        before = len(master.lines)
        for _ in range(TIMES):
            for octets in GARBAGE:
                with socket.create_connection(("127.0.0.1", port), timeout=60.0) as one:
                    one.sendall(octets)
                    one.shutdown(socket.SHUT_WR)
                    while one.recv(4096):
                        pass
        master.end()
        said = master.lines[before:]
        assert any("Invalid HTTP request" in line for line in said)
        invalid = [line for line in said if "Invalid HTTP request" in line]
        assert len(invalid) <= SAME + 1
        assert "more like it were not written" in invalid[-1]
        assert len(said) < 40, "\n".join(said)
