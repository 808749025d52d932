"""`msbot bus dump`, `send` and `load` on a bus of the kernel."""

from __future__ import annotations

from pathlib import Path

from tests.e2e.processes import run, running

FRAMES = ("103#C181010700", "1ABCDEF0#1122", "7FF#R4")
WITHOUT_END = ("--repeat", "100000", "--period", "0.05")
"""Whoever listens may be late: frames come until the test is over."""


def test_what_is_sent_is_dumped_in_words_and_written(tmp_path: Path) -> None:
    with running("bus", "dump", "vcan0", "--log", "bus.log", cwd=tmp_path) as dump:
        sent = run("bus", "send", "vcan0", *FRAMES, "--repeat", "5", "--period", "0.05", cwd=tmp_path)
        assert (sent.returncode, sent.stderr) == (0, "")
        # The dump may still be starting: frames are repeated until it has shown some.
        with running("bus", "send", "vcan0", *FRAMES, *WITHOUT_END, cwd=tmp_path):
            dump.wait_for("vcan0", "103", "C1 81 01 07 00", "node 3 to master")
            dump.wait_for("vcan0", "1ABCDEF0", "foreign")
            dump.wait_for("vcan0", "7FF", "remote request")
        assert dump.end() == 0
    assert {line.split()[2] for line in (tmp_path / "bus.log").read_text().splitlines()} == set(FRAMES)


def test_the_load_of_a_bus_is_measured(tmp_path: Path) -> None:
    sending = running("bus", "send", "can:vcan0", FRAMES[0], *WITHOUT_END, cwd=tmp_path)
    with running("bus", "load", "can:vcan0", "--bitrate", "125000", cwd=tmp_path) as load, sending:
        load.wait_for("load", "of 125 kbit/s")
        load.wait_for("103", "node 3 to master")


def test_an_interface_that_is_not_there_is_explained(tmp_path: Path) -> None:
    for command in (("dump", "vcan7"), ("load", "vcan7"), ("send", "vcan7", "123#01")):
        done = run("bus", *command, cwd=tmp_path)
        assert done.returncode == 2
        assert "there is no interface vcan7" in done.stderr
        assert "sudo ip link add dev vcan7 type vcan" in done.stderr
