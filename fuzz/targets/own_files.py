"""Parsers of what MsBOT's own programs leave for or say to each other: a file may be damaged, a port be another's."""

from __future__ import annotations

import asyncio
import json
import os
import tempfile
from collections.abc import Iterable
from functools import cache
from pathlib import Path
from types import SimpleNamespace
from typing import Any

from fuzz.case import Violation
from fuzz.targets.parser import Parser, file_of, lines
from fuzz.virtual import play
from msbot.cli.board.board_commands import SETTINGS, settings_file
from msbot.cli.board.board_connection import Board, BoardFacts
from msbot.config import SAMPLE_ROBOT_TOML, load_blueprint, load_library
from msbot.master import stop_socket
from msbot.master.stop_persistence import BrokenRecord, StopFile
from msbot.master.stop_socket import StopSocket
from msbot.operations.arguments import read_arguments
from msbot.operations.rights import Role
from msbot.operations.table import OPERATIONS
from msbot.pnp.emergency_stop import StopStatus
from msbot.registry import open_registry
from msbot.registry.maintenance import database_maintenance
from msbot.registry.maintenance.database_maintenance import fault_of
from msbot_agent.agent.status_files import FORMAT, PREFIX, find_status_files
from msbot_agent.agent.status_reader import status_in
from msbot_agent.link.can.sim import bus_names
from msbot_agent.link.contract import ConnectionUser
from msbot_agent.link.net import SocketPeer, WebSocketServerLink
from msbot_agent.text.untrusted_input import read_json
from msbot_school.classroom.rollout_run import RollOutLog
from msbot_web.access.accounts import Accounts
from msbot_web.access.session_file import SessionFile
from msbot_web.access.sign_in_throttle import SignInRefused
from msbot_web.access.ticket_codes import TicketCodes
from msbot_web.access.users import MemoryUsers
from msbot_xrce.errors import LinkDown
from tests.registry.hand import Hand
from tests.web.access.test_accounts import PlainHasher, user


def _writable(text: str) -> None:
    try:
        text.encode()
    except UnicodeEncodeError:
        raise Violation(f"no database takes {text!a:.100}") from None


def _named(octets: bytes, folder: str, name: str) -> Path:
    path = file_of(octets, ".json", folder=folder).with_name(name)
    path.write_bytes(octets)
    return path


def _accounts() -> Accounts:
    people = [user("ada", Role.ADMINISTRATOR), user("bob", Role.STUDENT)]
    return Accounts(MemoryUsers(*people), clock=lambda: 5.0, hasher=PlainHasher())


def _sessions(octets: bytes) -> Iterable[str]:
    accounts = _accounts()
    path = file_of(octets, ".json", folder="sessions")
    SessionFile(accounts, path, boot=lambda: "start", boot_clock=lambda: 100.0).bring_back()
    for session in accounts.sessions.to_persist(accounts.mark_of):
        _writable(session.name)
        yield f"{session.name in ('ada', 'bob')} {bool(session.guest_of)}"


def _pass(octets: bytes) -> Iterable[str]:
    passes = TicketCodes(_accounts(), lambda: 5.0, lambda: 1e9)
    text = octets.decode("utf-8", "surrogateescape")
    right = passes.make("bob", 3)
    for word in (text, right[: len(right) // 2] + text, f"{right.rpartition('.')[0]}.{text}"):
        try:
            yield passes.find(word)
        except SignInRefused as refused:
            yield str(refused)[:10]


def _stop_request(octets: bytes) -> Iterable[str]:
    said: list[tuple[str, ...]] = []
    answers: list[object] = []

    async def stored() -> StopStatus:
        return StopStatus()

    def say(*words: str) -> None:
        for word in words:
            _writable(word)
        said.append(words)

    master: Any = SimpleNamespace(say_stop=say, say_go=say, until_stop_is_stored=stored, stop=StopStatus())

    def send(answer: bytes) -> int:
        answers.append(answer)
        return len(answer)

    connection: Any = SimpleNamespace(send=send)

    async def take() -> None:
        place = StopSocket(master, lambda: {"robot": "R", "serial_number": "1", "database": "/r.db"})
        place._take(stop_socket._Connection(connection), octets)
        await asyncio.sleep(1.0)

    play(take())
    return (f"{len(said)} {[len(words) for words in said]} {len(answers)}",)


def _stop_record(octets: bytes) -> Iterable[str]:
    try:
        record = StopFile(file_of(octets, ".json", folder="stop")).read()
    except BrokenRecord:
        return ("broken",)
    return (f"{record and record.holds}",)


def _status_file(octets: bytes) -> Iterable[str]:
    return (f"{len(list(find_status_files(_named(octets, 'status', f'{PREFIX}1.json').parent)))}",)


def _status(octets: bytes) -> Iterable[str]:
    try:
        return (f"{len(status_in(1, octets.splitlines()).clients)} clients",)
    except (ValueError, KeyError, TypeError, AttributeError) as error:  # what `read_statuses` says a sentence about
        return (type(error).__name__,)


def _bus(octets: bytes) -> Iterable[str]:
    return (str(bus_names._read(file_of(octets, ".json", folder="bus")) is None),)


def _rollouts(octets: bytes) -> Iterable[str]:
    return (str(RollOutLog(_named(octets, "rollouts", "rollouts.json").parent).last() is None),)


def _request(octets: bytes) -> Iterable[str]:
    name, _, text = octets.partition(b" ")
    operation = OPERATIONS.get(name.decode("utf-8", "replace"))
    if operation is None:
        return
    try:
        given = read_json(text)
    except ValueError:
        return
    for value in read_arguments(operation, given).values():
        for one in value if isinstance(value, list) else [value]:
            _writable(str(one))
    yield f"{operation.name} read"


def _requests() -> Iterable[bytes]:
    values = {"texts": ["AA.out", "BB.in"], "number": 1.5, "whole": 3, "flag": True, "value": 0.5}
    for operation in OPERATIONS.values():
        given = {one.name: values.get(one.kind.name.lower(), "AA") for one in operation.arguments}
        yield f"{operation.name} {json.dumps(given)}".encode()


def _part_packet(octets: bytes) -> Iterable[str]:
    link = WebSocketServerLink("ws:fuzz")
    heard: list[bytes] = []
    link.attach(packet=lambda packet, _peer, _now: heard.append(packet))

    async def come() -> tuple[str, ...]:
        running = asyncio.create_task(link.run())
        await asyncio.sleep(0)
        peer: SocketPeer = link.join(ConnectionUser("ann", "10.0.0.1"))
        try:
            pause_s, words = peer.receive(octets, asyncio.get_running_loop().time())
        except ValueError as error:
            return (str(error)[:20],)
        finally:
            peer.connection_ended("end")
            running.cancel()
        return (f"{pause_s > 0} {words[:10]} {heard == [octets]}",)

    return play(come())


class _Serial:
    """A board that prints the same whatever it is asked."""

    def __init__(self, octets: bytes) -> None:
        self._octets = octets

    def exec_raw(self, _code: str, timeout: float) -> tuple[bytes, bytes]:
        assert timeout > 0
        return self._octets, b""


def _board(octets: bytes) -> Iterable[str]:
    serial: Any = _Serial(octets)
    board = Board(serial, "fuzz")
    for read in (board.facts, lambda: board.free_space("/"), lambda: board.files("/"), lambda: board.read("/x")):
        try:
            yield f"{type(read()).__name__} read"
        except LinkDown as error:
            yield str(error)[:60]


def _board_settings(octets: bytes) -> Iterable[str]:
    there: Any = SimpleNamespace(files=lambda _folder: {SETTINGS: None}, read=lambda _path: octets)
    facts = BoardFacts("fuzz", (1, 22), 6, "/lib", "")
    written = settings_file(there, facts, link="can:1", wifi=None, token=None)
    assert written is not None
    settings = json.loads(written, parse_constant=_no_number)
    if settings["link"] != "can:1":
        raise Violation(f"the board would be told {written!r:.200}")
    return (f"{min(len(settings), 3)} settings",)


def _no_number(words: str) -> None:
    raise Violation(f"no board can read {words}")


def _backup(octets: bytes) -> Iterable[str]:
    path = file_of(octets, ".db")
    try:
        return (fault_of(str(path), needs_administrator=True)[:40],)
    finally:
        for beside in path.parent.glob(f"{path.name}?*"):  # its journal, and a copy of each that was of an older schema
            beside.unlink()


@cache
def _backups() -> tuple[bytes, ...]:
    with tempfile.TemporaryDirectory(prefix="msbot-fuzz-") as folder:
        path = Path(folder) / "robot.db"
        (Path(folder) / "robot.toml").write_text(SAMPLE_ROBOT_TOML)
        library = load_library()
        with open_registry(path) as registry:
            blueprint = load_blueprint(Path(folder) / "robot.toml", library)
            registry.runs.begin(registry.robots.apply_blueprint(blueprint, library))
            Hand(registry).keep_user("ada", "administrator", "ada", password_hash="hash")
        database_maintenance.back_up(str(path), Path(folder) / "backup.db")
        return ((Path(folder) / "backup.db").read_bytes(),)


_STATUS = (
    json.dumps(
        {
            "format": FORMAT,
            "what": "agent",
            "name": "a",
            "details": {},
            "up_s": 1.5,
            "links": [],
            "topics": [],
            "dropped": {},
        }
    )
    + '\n{"end": 0}'
)
_SESSION = json.dumps(
    {"key": "ab", "name": "bob", "csrf": "x", "age_s": 5.0, "idle_s": 1.0, "guest_of": "",
     "mark": _accounts().mark_of("bob")}
)  # fmt: skip

OWN: dict[str, Parser] = {
    "sessions": Parser(
        _sessions,
        lines(
            '{"at": 1e12, "forward_s": 1e12, "boot": "start", "boot_s": 0.0, "ticket_key": "'
            + "00" * 32
            + '", "browsers": [["a", "bob"]], "sessions": ['
            + _SESSION
            + "]}"
        ),
    ),
    "pass": Parser(_pass, lines("Ym9i.3b9ef000.abcdef", ".ffffffff.", "\u0661.\u0661.\u0661")),
    "stop_request": Parser(
        _stop_request,
        lines(
            '{"do": "stop", "who": "ann", "reason": "smoke", "robot": null, "expires": 5.5}',
            '{"do": "go", "who": "ann", "robot": "R", "serial_number": "1", "database": "/r.db"}',
            '{"do": "status"}',
        ),
    ),
    "stop_record": Parser(
        _stop_record, lines('{"number": 3, "holds": true, "by": "ann", "reason": "x", "at_ns": 1700000000000000000}')
    ),
    "status_file": Parser(_status_file, lines(json.dumps({"port": 5555, "token": "abc", "pid": os.getpid()}))),
    "status": Parser(_status, lines(_STATUS)),
    "board": Parser(
        _board,
        lines(
            "('micropython', (1, 24, 0), 'Pico', 6, ['/lib'], '/')", "(4096, 4096, 212, 150)", "None",
            "('boot.py', 12, b'abc'),\n('msbot.json', 5, None),", "b'{}'", "5", "(0, 0, 0, 0)", "(" * 3000,
        ),
    ),
    "board_settings": Parser(
        _board_settings,
        lines('{"link": "can:1", "wifi": ["a", "b"], "token": "x", "more": [1.5, null]}', "[]", '{"a": NaN}',
              '{"a":' * 900 + "1" + "}" * 900),
    ),
    "backup": Parser(_backup, _backups),
    "bus_file": Parser(
        _bus,
        lines(
            '{"name": "classroom", "port": 5, "key": "00ff", "pid": 1, "bitrate": 500000, "data_bitrate": null, '
            '"fd": false}'
        ),
    ),
    "rollouts": Parser(_rollouts, lines('[{"at": 1.5, "blueprint": "robot.toml", "done": []}]', "[]")),
    "request": Parser(_request, _requests),
    "part_packet": Parser(_part_packet, lines("8100", "x" * 300)),
}  # fmt: skip
"""By name."""
