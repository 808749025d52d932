"""A student's program from the shell's point of view: options, one sentence for a mistake, a clean end."""

import asyncio
import os
import signal
import sys
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from pathlib import Path

import pytest

from msbot.part.join import pnp_messages
from msbot.part.part import Part
from msbot.part.run import run
from msbot_agent.link.net import UdpServerLink
from tests.part.wire import SmallMaster, publishes

OF_A_BUSY_COMPUTER = (
    "still looking",
    "does not answer part",
    "no master has said which robot",
    "cannot beat meanwhile",
)
"""What a part rightly says when it, or its master, stands still for seconds."""

TWO = {"ABCD": [publishes("out", "T")], "EFGH": [publishes("out", "U")]}

PROGRAM = """
from msbot import HelloWorld, Part, run

parts = [Part(number) for number in {numbers!r}]

for part in parts:
    @part.every(0.05)
    def tick(part=part):
        part.publish({port!r}, HelloWorld(index=1, message="x"))

    @part.on_end
    def ended(part=part):
        print(part.part_number, "ended", flush=True)

run(*parts)
"""


@asynccontextmanager
async def master_on_udp(bindings: dict[str, list[pnp_messages.PortBinding]]) -> AsyncIterator[tuple[SmallMaster, str]]:
    server = UdpServerLink("127.0.0.1", 0)
    master = SmallMaster(bindings, server=server)
    master.start()
    await until(lambda: server.port != 0)
    try:
        yield master, f"udp:127.0.0.1:{server.port}"
    finally:
        await master.kill()


async def until(condition: Callable[[], bool]) -> None:
    async with asyncio.timeout(20.0):
        while not condition():  # noqa: ASYNC110 - it becomes true in another process
            await asyncio.sleep(0.01)


def complaints(err: bytes) -> list[str]:
    """What a program has said on stderr, without what it says on a computer that is too busy."""
    return [line for line in err.decode().splitlines() if not any(words in line for words in OF_A_BUSY_COMPUTER)]


async def start(
    tmp_path: Path, link: str, *options: str, port: str = "out", numbers: str = "A"
) -> asyncio.subprocess.Process:
    program = tmp_path / "program.py"
    program.write_text(PROGRAM.format(port=port, numbers=["ABCD", "EFGH"] if numbers == "AE" else ["ABCD"]))
    return await asyncio.create_subprocess_exec(
        sys.executable,
        str(program),
        *options,
        env={**os.environ, "MSBOT_LINK": link, "XDG_STATE_HOME": str(tmp_path)},
        stdout=asyncio.subprocess.PIPE,
        stderr=asyncio.subprocess.PIPE,
    )


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
async def test_a_program_joins_over_udp_and_ends_politely_on_a_signal(tmp_path: Path, number: signal.Signals) -> None:
    async with master_on_udp(TWO) as (master, link):
        process = await start(tmp_path, link, "--quiet", numbers="AE")
        await until(lambda: len(master.configured) == 2)
        assert len(master.agent.clients()) == 3
        process.send_signal(number)
        out, err = await process.communicate()
        assert process.returncode == 0
        assert sorted(out.decode().split("\n")) == ["", "ABCD ended", "EFGH ended"]
        assert complaints(err) == []
        assert len(master.agent.clients()) == 1
        assert sorted(path.name for path in (tmp_path / "msbot/uid").iterdir()) == ["ABCD.ABCD", "EFGH.EFGH"]


async def test_a_wrong_port_is_one_sentence_and_status_2(tmp_path: Path) -> None:
    async with master_on_udp(TWO) as (_, link):
        process = await start(tmp_path, link, "--quiet", port="outt")
        _, err = await process.communicate()
        assert process.returncode == 2
        what = "there is no port 'outt' to publish on; bound in this robot: out (publish HelloWorld)"
        assert complaints(err) == [f"program.py:9 in tick: {what}"]


async def test_the_story_of_the_part_is_told_unless_quiet(tmp_path: Path) -> None:
    async with master_on_udp(TWO) as (master, link):
        process = await start(tmp_path, link)
        await until(lambda: ("configuration", "ABCD") in master.requests)
        process.send_signal(signal.SIGINT)
        _, err = await process.communicate()
        told = [line.partition(" ")[2] for line in complaints(err)]
        assert told[:2] == [
            "ABCD is recognising: agent found, waiting for the robot's profile",
            "ABCD is claiming: recognised robot MSBOT_MASTER",
        ]
        assert told[-1] == "ABCD has ended"


@pytest.mark.parametrize(
    ("args", "words"),
    [
        (["--link", "nowhere"], "link 'nowhere': unknown kind of link 'nowhere'"),
        (["--link", "udp:127.0.0.1:99999"], "port 99999 is not from 1 to 65535"),
        (["--link", "udp:no.such.host.invalid:8888"], "no such host as 'no.such.host.invalid'"),
        (["--link", "udp:127.0.0.1:8888", "--uid", "12"], "UID '12': write 16 hexadecimal digits"),
    ],
)
def test_what_the_user_can_mend_is_one_sentence_and_status_2(
    args: list[str], words: str, capsys: pytest.CaptureFixture[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))
    with pytest.raises(SystemExit) as caught:
        Part("ABCD").run(args)
    assert caught.value.code == 2
    said = capsys.readouterr().err
    assert words in said
    assert len(said.splitlines()) == 1


def test_a_text_is_no_command_line(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as caught:
        Part("ABCD").run("udp:10.0.0.1:8888")  # type: ignore[arg-type]
    assert caught.value.code == 2
    said = capsys.readouterr().err
    assert said == "run() takes a list, as a command line is one: run([\"--link\", 'udp:10.0.0.1:8888'])\n"


def test_an_unknown_option_is_a_mistake_too(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as caught:
        run(Part("ABCD"), args=["--lnik", "udp:127.0.0.1:8888"])
    assert caught.value.code == 2
    assert "unrecognized arguments: --lnik" in capsys.readouterr().err


def test_a_uid_of_the_command_line_is_for_one_part(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as caught:
        run(Part("ABCD"), Part("EFGH"), args=["--uid", "0011223344556677"])
    assert caught.value.code == 2
    assert "--uid is for a program with one part, this one has 2" in capsys.readouterr().err


def test_nothing_to_run_is_a_mistake(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        run(args=[])
    assert "run() needs a part" in capsys.readouterr().err


def test_the_uid_of_the_command_line_is_used(monkeypatch: pytest.MonkeyPatch) -> None:
    part = Part("ABCD")
    seen: list[bytes | None] = []

    async def run_async(_link: object) -> None:
        seen.append(part.uid)

    monkeypatch.setattr(part, "run_async", run_async)
    run(part, args=["--uid", "0011223344556677", "--quiet"])
    assert seen == [bytes.fromhex("0011223344556677")]


def test_a_key_on_the_command_line_is_told_to_be_readable_by_others(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    part = Part("ABCD")

    async def run_async(_link: object) -> None:
        pass

    monkeypatch.setattr(part, "run_async", run_async)
    key = "00112233445566778899aabbccddeeff"
    (tmp_path / "key").write_text(key)
    run(part, args=["--key", str(tmp_path / "key"), "--uid", "0011223344556677", "--quiet"])
    assert caplog.messages == []
    run(part, args=["--key", key, "--uid", "0011223344556677", "--quiet"])
    (told,) = caplog.messages
    assert "every user of this computer can read the key" in told
    assert key not in told
