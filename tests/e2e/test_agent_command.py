"""`msbot agent` and `msbot clients` as a user runs them, with our own client at the other end."""

from __future__ import annotations

import asyncio
import json
import re
import signal
import socket
import struct
import time
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path
from tempfile import TemporaryFile

import pytest

from msbot.part import ConnectionState, find_agents
from msbot.recording.recorder.recording_file import ENCAPSULATION
from msbot.recording.recordings.mcap_reader import RecordingReader
from msbot_agent.agent.discovery import DISCOVERY_GROUP
from msbot_agent.link import Link, open_link
from msbot_agent.link.serial import SerialClientLink
from msbot_xrce.messages import ObjectKind, make_object_id
from msbot_xrce.objects import publisher_variant
from tests.agent.replay import load
from tests.e2e.processes import PATIENCE_S, Process, run, running
from tests.hearing_client import HearingClient
from tests.link.net.test_udp import has_ipv6
from tests.link.ports import Board

PING = bytes.fromhex("80000000 02010800 000afffd 02000000")
needs_ipv6 = pytest.mark.skipif(not has_ipv6(), reason="no IPv6 here")


@pytest.fixture
def place(tmp_path: Path) -> dict[str, str]:
    """The environment of commands that shall not see other agents of this user."""
    return {"XDG_RUNTIME_DIR": str(tmp_path)}


def port_of(agent: Process) -> int:
    """The port that an agent with `-p 0` has."""
    found = re.search(r":(\d+), for this computer only|:(\d+); Ctrl-C", agent.wait_for("agent on"))
    assert found is not None
    return int(found[1] or found[2])


@asynccontextmanager
async def connected(link: Link, key: int = 0xAABBCCDD) -> AsyncIterator[HearingClient]:
    """One of our clients with a session."""
    client = HearingClient(link, key=key)
    task = asyncio.create_task(client.run())
    try:
        await client.connect(PATIENCE_S)
        yield client
    finally:
        task.cancel()
        await asyncio.gather(task, return_exceptions=True)


async def hear_oneself(client: HearingClient) -> None:
    """Publish three samples and receive them: small, larger than a message, and with octets that framings escape."""
    came: asyncio.Queue[bytes] = asyncio.Queue()
    client.on_topic = lambda object_id, request_id, payload: came.put_nowait(payload)
    participant = client.create_participant()
    topic = client.create_topic(participant, "light", "T")
    writer = client.create_writer(client.create_publisher(participant), topic)
    client.read(client.create_reader(client.create_subscriber(participant), topic))
    await client.until_all_statuses(PATIENCE_S)
    for sample in (b"x", bytes(range(256)) * 12, b"\x7e\x7d" * 40):
        while not client.has_room():  # noqa: ASYNC110 - the test has time
            await asyncio.sleep(0)
        client.write(writer, sample)
        async with asyncio.timeout(PATIENCE_S):
            assert await came.get() == sample


@pytest.mark.parametrize(
    ("transport", "address"),
    [
        ("udp4", "udp:127.0.0.1:{}"),
        ("tcp4", "tcp:127.0.0.1:{}"),
        pytest.param("udp6", "udp:[::1]:{}", marks=needs_ipv6),
        pytest.param("tcp6", "tcp:[::1]:{}", marks=needs_ipv6),
    ],
)
async def test_our_client_over_ip(tmp_path: Path, place: dict[str, str], transport: str, address: str) -> None:
    with running("agent", transport, "-p", "0", cwd=tmp_path, env=place) as agent:
        port = await asyncio.to_thread(port_of, agent)
        async with connected(open_link(address.format(port))) as client:
            await hear_oneself(client)
            listing = await asyncio.to_thread(run, "clients", "--json", env=place)
        assert agent.end(signal.SIGINT) == 0
    (status,) = json.loads(listing.stdout)
    (seen,) = status["clients"]
    assert (seen["key"], seen["published"], seen["delivered"]) == ("AABBCCDD", 3, 3)
    assert len(seen["objects"]) == 6
    assert not list((tmp_path / "msbot").iterdir()), "the file is gone with the agent"


@pytest.mark.parametrize("verbose", ["4", "5", "6"])
async def test_greeting_log_and_packets_are_in_standard_output(
    tmp_path: Path, place: dict[str, str], verbose: str
) -> None:
    """`MicroXRCEAgent ... > log` has everything in the file, in order, and each line at once."""
    with (
        TemporaryFile() as errors,
        running("agent", "udp4", "-p", "0", "-v", verbose, cwd=tmp_path, env=place, errors=errors) as agent,
    ):
        port = await asyncio.to_thread(port_of, agent)
        async with connected(open_link(f"udp:127.0.0.1:{port}")) as client:
            await hear_oneself(client)
            client.create(publisher_variant(make_object_id(77, ObjectKind.PARTICIPANT)))
            await asyncio.to_thread(agent.wait_for, "CREATE without its parent (04D1)")
        assert agent.end(signal.SIGINT) == 0
        errors.seek(0)
        assert errors.read() == b""
    told = "\n".join(agent.lines)
    assert "client AABBCCDD logged in from 127.0.0.1:" in told
    assert ("AABBCCDD created datawriter" in told) == (verbose >= "5")
    assert ("on stream 80: light" in told) == (verbose >= "5")
    assert ("CREATE_CLIENT" in told) == (verbose == "6")


async def test_how_many_objects_a_client_may_have_is_the_users(tmp_path: Path, place: dict[str, str]) -> None:
    with running("agent", "udp4", "-p", "0", "--max-objects", "5", cwd=tmp_path, env=place) as agent:
        port = await asyncio.to_thread(port_of, agent)
        async with connected(open_link(f"udp:127.0.0.1:{port}")) as client:
            participant = client.create_participant()
            for number in range(5):
                client.create_topic(participant, f"t{number}", "T")
            await asyncio.to_thread(agent.wait_for, "client AABBCCDD: object 0052 is refused", "beyond 5 of one client")
            listing = await asyncio.to_thread(run, "clients", env=place)
        assert "1 x object beyond 5 of one client" in listing.stdout
    for wrong in ("0", "32769", "many"):
        refused = run("agent", "udp4", "-p", "0", "--max-objects", wrong, cwd=tmp_path, env=place)
        assert refused.returncode == 2
        assert "--max-objects" in refused.stderr


def complete(path: Path) -> RecordingReader:
    """A recording: on a busy computer its process may need longer for the end than the agent waits."""
    until = time.monotonic() + PATIENCE_S
    while not path.exists() or (reader := RecordingReader(path)).damage:
        assert time.monotonic() < until, path
        time.sleep(0.1)
    return reader


async def test_what_clients_say_is_recorded(tmp_path: Path, place: dict[str, str]) -> None:
    with running("agent", "udp4", "-p", "0", "--rec", "a.mcap", cwd=tmp_path, env=place) as agent:
        port = await asyncio.to_thread(port_of, agent)
        async with connected(open_link(f"udp:127.0.0.1:{port}")) as client:
            await hear_oneself(client)
        assert agent.end(signal.SIGINT) == 0
    reader = complete(tmp_path / "a.mcap")
    samples = [message for message in reader.messages() if message.topic == "/light"]
    assert reader.damage == ""
    assert [one.data.removeprefix(ENCAPSULATION) for one in samples] == [b"x", bytes(range(256)) * 12, b"\x7e\x7d" * 40]
    assert {one.channel.metadata["type"] for one in samples} == {"T"}
    with running("agent", "udp4", "-p", "0", "--rec", "bag.mcap,ros2", cwd=tmp_path, env=place) as agent:
        port = await asyncio.to_thread(port_of, agent)
        async with connected(open_link(f"udp:127.0.0.1:{port}")) as client:
            await hear_oneself(client)  # in a type that nobody knows
        await asyncio.to_thread(agent.wait_for, "bag.mcap leaves out what is no ROS 2 message: /light")
        assert agent.end(signal.SIGINT) == 0
    bag = complete(tmp_path / "bag.mcap")
    assert (list(bag.messages()), bag.damage) == ([], "")
    for file, words in (
        ("a.mcap", "is there already"),
        ("a.mcap,ros2", "is there already"),
        ("b.txt", "ends in .mcap: b.txt.mcap"),
        ("no/b.mcap", "there is no folder"),
    ):
        refused = run("agent", "udp4", "-p", "0", "--rec", file, cwd=tmp_path, env=place)
        assert refused.returncode == 2
        assert words in refused.stderr


async def test_our_client_over_a_pseudo_terminal(tmp_path: Path, place: dict[str, str]) -> None:
    pytest.importorskip("serialx", reason="needs the extra [serial]")
    with running("agent", "pseudoterminal", "-v6", cwd=tmp_path, env=place) as agent:
        line = await asyncio.to_thread(agent.wait_for, "agent on pty:, opened /dev/")
        path = re.search(r"opened (\S+);", line)
        assert path is not None
        async with connected(SerialClientLink(path[1])) as client:
            await hear_oneself(client)
        agent.wait_for("CREATE_CLIENT")
        assert agent.end(signal.SIGTERM) == 0


async def test_a_board_on_a_serial_port_that_is_plugged_in_later_and_pulled_out(
    tmp_path: Path, place: dict[str, str]
) -> None:
    pytest.importorskip("serialx", reason="needs the extra [serial]")
    board = Board(tmp_path / "ttyBOARD")
    login = bytes.fromhex("80000000 00011000 58524345 0100010f aabbccdd 8100fc01")
    with running("agent", "serial", "--dev", board.port, "-b", "115200", cwd=tmp_path, env=place) as agent:
        await asyncio.to_thread(agent.wait_for, f"serial port {board.port} is not there")
        await asyncio.to_thread(agent.wait_for, "agent on serial:", "no port yet")
        board.plug()
        answer = await say_until_heard(board, login)
        assert answer.hex() == "8100000004010b0000005852434501 00010f00".replace(" ", "")
        await asyncio.to_thread(agent.wait_for, "client AABBCCDD logged in", f"{board.port} address 1")
        board.pull()
        await asyncio.to_thread(agent.wait_for, "client AABBCCDD", "is gone: port broken")
        board.plug()
        await asyncio.to_thread(agent.wait_for, "client AABBCCDD", "is back")
        knows_us = (await say_until_heard(board, b"\x81" + PING[1:]))[13]
        assert knows_us == 1
        assert agent.end() == 0
    board.pull()


async def say_until_heard(board: Board, packet: bytes) -> bytes:
    """What a board does: it repeats itself until the agent has opened the port."""
    async with asyncio.timeout(PATIENCE_S):
        while True:
            board.say(packet)
            try:
                async with asyncio.timeout(0.2):
                    return await board.hear()
            except TimeoutError:
                continue


async def test_a_genuine_client_finds_its_objects_after_its_connection_broke(
    tmp_path: Path, place: dict[str, str]
) -> None:
    """Recorded octets of eProsima's C client over TCP; closed in the middle, opened again, logged in again."""
    packets = [line.packet for line in load("tcp_session") if line.from_client]
    login = next(packet for packet in packets if packet[4] == 0)
    participant = bytes.fromhex("81800000 01011000 000a0011 01030000 02000000 00000000")
    with running("agent", "tcp4", "-p", "0", cwd=tmp_path, env=place) as agent:
        port = await asyncio.to_thread(port_of, agent)
        statuses = []
        for _ in range(2):
            reader, writer = await asyncio.open_connection("127.0.0.1", port)
            for packet in (login, participant):
                writer.write(struct.pack("<H", len(packet)) + packet)
            answers = [await reader.readexactly(struct.unpack("<H", await reader.readexactly(2))[0]) for _ in range(3)]
            statuses.append([answer[12] for answer in answers if answer[4] == 5])
            writer.close()
            await asyncio.to_thread(agent.wait_for, "is gone: connection closed")
    assert statuses == [[0x00], [0x82]], "the second time it exists already"


@pytest.mark.parametrize(("transport", "kind"), [("udp4", "udp"), ("tcp4", "tcp")])
async def test_our_client_comes_back_after_the_agent_was_killed(
    tmp_path: Path, place: dict[str, str], transport: str, kind: str
) -> None:
    with running("agent", transport, "-p", "0", cwd=tmp_path, env=place) as first:
        port = await asyncio.to_thread(port_of, first)
        async with connected(open_link(f"{kind}:127.0.0.1:{port}")) as client:
            states: asyncio.Queue[ConnectionState] = asyncio.Queue()
            client.on_state = lambda state, reason: states.put_nowait(state)
            await asyncio.to_thread(first.end, signal.SIGKILL)
            async with asyncio.timeout(PATIENCE_S):
                assert await states.get() is ConnectionState.LOST
                with running("agent", transport, "-p", str(port), cwd=tmp_path, env=place):
                    assert await states.get() is ConnectionState.CONNECTED
                    await hear_oneself(client)


async def test_an_agent_is_found_by_multicast(tmp_path: Path, place: dict[str, str]) -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("", 0))
        discovery = probe.getsockname()[1]
    with running("agent", "udp4", "-p", "0", "-d", str(discovery), cwd=tmp_path, env=place) as agent:
        port = await asyncio.to_thread(port_of, agent)
        (found,) = await find_agents([(DISCOVERY_GROUP, discovery)], enough=1, attempts=40)
        assert found.address == ("127.0.0.1", port)


def test_it_needs_the_base_install_only(tmp_path: Path, place: dict[str, str]) -> None:
    for extra in ("serialx", "can", "sqlalchemy", "alembic", "psycopg"):
        (tmp_path / f"{extra}.py").write_text(f"raise ImportError('{extra} is not in the base install')")
    env = {**place, "PYTHONPATH": str(tmp_path)}
    with running("agent", "udp4", "-p", "0", cwd=tmp_path, env=env) as agent:
        port = port_of(agent)
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as client:
            client.settimeout(PATIENCE_S)
            client.sendto(PING, ("127.0.0.1", port))
            assert client.recv(100)[4] == 6
        assert run("clients", env=env).stdout.startswith(f"agent on udp:127.0.0.1:{port}, ")


def test_a_port_in_use_is_one_sentence(tmp_path: Path, place: dict[str, str]) -> None:
    for transport, kind in (("udp4", socket.SOCK_DGRAM), ("tcp4", socket.SOCK_STREAM)):
        with socket.socket(socket.AF_INET, kind) as taken:
            taken.bind(("127.0.0.1", 0))
            if kind is socket.SOCK_STREAM:
                taken.listen()
            port = taken.getsockname()[1]
            done = run("agent", transport, "-p", str(port), cwd=tmp_path, env=place)
        assert done.returncode == 2
        assert done.stdout == ""
        assert f"127.0.0.1:{port}: another program listens there" in done.stderr
        assert len(done.stderr.splitlines()) == 1


def test_other_mistakes_are_one_sentence_each(tmp_path: Path, place: dict[str, str]) -> None:
    (tmp_path / "refs.xml").write_text("<profiles>")
    for arguments, words in (
        (("udp4", "-p", "0", "-r", "refs.xml"), "refs.xml"),
        (("udp4", "-p", "0", "--host", "192.0.2.77"), "no interface of this machine has the address"),
        (("udp4", "-p", "0", "--host", "::1"), "use `msbot agent udp6`"),
        (("serial", "-D", "/dev/null"), "it is not a serial port"),
    ):
        done = run("agent", *arguments, cwd=tmp_path, env=place)
        assert (done.returncode, done.stdout) == (2, ""), arguments
        assert words in done.stderr
        assert len(done.stderr.splitlines()) == 1


def test_a_killed_agent_is_not_listed(tmp_path: Path, place: dict[str, str]) -> None:
    with running("agent", "udp4", "-p", "0", cwd=tmp_path, env=place) as agent:
        port = port_of(agent)
        assert f"agent on udp:127.0.0.1:{port}, " in run("clients", env=place).stdout
        agent.end(signal.SIGKILL)
    assert len(list((tmp_path / "msbot").iterdir())) == 1
    assert run("clients", env=place).stdout.startswith("No agent or master of yours is running")
    assert not list((tmp_path / "msbot").iterdir())


def test_a_master_shows_its_clients_too(tmp_path: Path, place: dict[str, str]) -> None:
    assert run("init", cwd=tmp_path).returncode == 0
    with running("master", "--no-page", "--link", f"pty:{tmp_path / 'robot.tty'}", cwd=tmp_path, env=place) as master:
        master.wait_for("is up on", "robot.tty")
        (status,) = json.loads(run("clients", "--json", env=place).stdout)
        assert status["what"] == "master"
        assert status["name"].startswith("MSBOT_MASTER")
        assert [client["link"] for client in status["clients"]] == ["inproc"] * 3
        assert master.end() == 0
