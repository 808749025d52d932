"""Reads the status of this user's agents, and sends them requests."""

from __future__ import annotations

import json
import logging
import socket
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import field
from pathlib import Path
from typing import Any, Final

from msbot_agent.agent.statistics import ClientView, ObjectView, StreamView
from msbot_agent.agent.status_files import DESCRIBE, FORMAT, StatusFile, find_status_files, status_folder
from msbot_agent.text.untrusted_input import read_program_json
from msbot_xrce.errors import ConfigError
from msbot_xrce.lazy import dataclass

MASTER: Final = "master"
"""What a master says that it is."""

logger = logging.getLogger(__name__)

ANSWER_S = 5.0
"""Time for an answer, so that an agent stopped in a debugger does not hold up the others for longer."""


@dataclass(frozen=True, slots=True)
class LinkView:
    """One link of an agent, for people."""

    name: str
    packets_in: int
    packets_out: int
    bytes_in: int
    bytes_out: int
    dropped: dict[str, int]
    """What was not delivered or not sent, by reason in words."""


@dataclass(frozen=True, slots=True)
class AgentStatus:
    """One running agent or master."""

    pid: int
    what: str
    """`agent` or `master`."""
    name: str
    """The robot of a master, or the links of an agent."""
    up_s: float
    """How long it has been running."""
    links: tuple[LinkView, ...]
    topics: tuple[tuple[str, int, int], ...]
    """`(name, published, delivered)`."""
    dropped: dict[str, int]
    """Packets that belong to no client, by reason in words."""
    clients: tuple[ClientView, ...]
    """All sessions, by key."""
    details: dict[str, str] = field(default_factory=dict)
    """Further details of the process: for a master, its robot and database."""


@dataclass(frozen=True, slots=True)
class RunningProcess:
    """A process that takes requests."""

    file: StatusFile
    what: str
    """`agent` or `master`."""
    name: str
    details: dict[str, str]

    def ask(
        self, request: Mapping[str, object], *, patience_s: float = ANSWER_S, waits_s: float = 0.0
    ) -> dict[str, object]:
        """Send a request and return the answer.

        Args:
            request: what is asked for.
            patience_s: time for the answer.
            waits_s: time that the process itself may wait before it answers, in addition.

        Raises:
            ConfigError: it does not answer, or its answer makes no sense.
        """
        try:
            return _ask(self.file, request, patience_s + waits_s)
        except (OSError, ValueError) as error:
            raise ConfigError(f"{self.what} {self.name} (process {self.file.pid}) does not answer: {error}") from error


def running_processes(folder: Path | None = None) -> Iterator[RunningProcess]:
    """The running agents and masters of this user; those that do not answer are left out, with a warning.

    Raises:
        ConfigError: the folder with their files is not the user's own.
    """
    for file in find_status_files(folder or status_folder()):
        try:
            head = _ask(file, {"do": DESCRIBE})
            if head.get("format") != FORMAT:
                raise ValueError("it is of another version, or no agent")
            details = head["details"]
            if not isinstance(details, dict):
                raise ValueError("it is of another version, or no agent")
            yield RunningProcess(file, str(head["what"]), str(head["name"]), details)
        except ConnectionRefusedError:
            file.path.unlink(missing_ok=True)  # its process number belongs to another process by now
        except (OSError, ValueError, KeyError) as error:
            logger.warning("process %d did not say what it is: %s", file.pid, error)


def read_statuses(folder: Path | None = None) -> list[AgentStatus]:
    """Ask every running agent and master of this user; those that do not answer are left out, with a warning.

    Raises:
        ConfigError: the folder with their files is not the user's own.
    """
    statuses = []
    for file in find_status_files(folder or status_folder()):
        try:
            statuses.append(_read(file))
        except ConnectionRefusedError:
            file.path.unlink(missing_ok=True)  # its process number belongs to another process by now
        except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
            logger.warning("process %d did not say how it is: %s", file.pid, error)
    return statuses


def _ask(file: StatusFile, request: Mapping[str, object], patience_s: float = ANSWER_S) -> dict[str, object]:
    line = file.token.encode() + b" " + json.dumps(request).encode() + b"\n"
    with socket.create_connection(("127.0.0.1", file.port), timeout=patience_s) as connection:
        connection.sendall(line)
        with connection.makefile("rb") as stream:
            answer = read_program_json(stream.readline() or b"null")
    if not isinstance(answer, dict):
        raise ValueError("it gave no answer")
    return answer


def _object(item: dict[str, Any]) -> ObjectView:
    return ObjectView(**{**item, "troubles": tuple(item["troubles"])})


def _read(file: StatusFile) -> AgentStatus:
    with socket.create_connection(("127.0.0.1", file.port), timeout=ANSWER_S) as connection:
        connection.sendall(file.token.encode() + b"\n")
        with connection.makefile("rb") as stream:
            return status_in(file.pid, stream)


def status_in(pid: int, answer: Iterable[bytes]) -> AgentStatus:
    """The status in the lines of an answer.

    Raises:
        ValueError, KeyError, TypeError, AttributeError: it is none.
    """
    lines = [read_program_json(line) for line in answer]
    if not lines or lines[0].get("format") != FORMAT:
        raise ValueError("it is of another version, or no agent")
    if lines[-1] != {"end": len(lines) - 2}:
        raise ValueError("its answer broke off")
    head = lines[0]
    clients = [
        ClientView(
            **{
                **client,
                "objects": tuple(_object(item) for item in client["objects"]),
                "streams": tuple(StreamView(**item) for item in client["streams"]),
            }
        )
        for client in lines[1:-1]
    ]
    return AgentStatus(
        pid=pid,
        what=head["what"],
        name=head["name"],
        up_s=head["up_s"],
        links=tuple(LinkView(**link) for link in head["links"]),
        topics=tuple((name, published, delivered) for name, published, delivered in head["topics"]),
        dropped=head["dropped"],
        details=head.get("details", {}),
        clients=tuple(sorted(clients, key=lambda view: view.key)),
    )
