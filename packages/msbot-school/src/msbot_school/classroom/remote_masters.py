"""Speaks to masters on other computers, by the API of their pages: to all at once, and to each for a bounded time.

Each has a thread of its own, name look-up included, so none waits for another one; nobody waits for a thread. What an
answer has told is kept as it comes in: whoever asks gets what is known when the time is over.
"""

from __future__ import annotations

import http.client
import json
import socket
import ssl
import threading
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from functools import lru_cache
from typing import Any, Final, Generic, TypeVar
from urllib.parse import urlsplit

from msbot_agent.text.sentence import printable, said
from msbot_agent.text.untrusted_input import read_remote_json
from msbot_school.classroom.remote_access import RemoteAccess
from msbot_xrce.errors import ConfigError, DatabaseBusy

MOST_OCTETS: Final = 1 << 20
"""Longest answer that is read."""
LOOK_S: Final = 3.0
"""How long a look at all of them takes at most."""
STOP_S: Final = 5.0
"""How long each has to take STOP and to say who has confirmed it."""
CHANGE_S: Final = 30.0
"""How long a change may take: it is checked and stored there."""
CONFIRM_S: Final = 2.0
"""How long parts are waited for."""
AGAIN_S: Final = 0.05

_R = TypeVar("_R")
Answer = dict[str, Any]
_NOTHING_CHANGED: Final = (400, 403, 404, 413, 422)
"""Statuses by which the API refuses before anything is done."""


class RemoteMasterError(ConfigError):
    """A master elsewhere cannot be reached, or refuses; the text says which and why."""


class RemoteMasterRefusal(RemoteMasterError):
    """It has answered, and does not do it: nothing has changed there."""


class RemoteMasterBusy(RemoteMasterRefusal, DatabaseBusy):
    """It does not do it now: another program is writing to its database."""


class RemoteMasterConnection:
    """A connection to one master, for one thread; another one may cut it.

    Args:
        access: whose.
        until: when its time is over, by the monotonic clock.
    """

    def __init__(self, access: RemoteAccess, until: float) -> None:
        self._access = access
        self._until = until
        self._connection: http.client.HTTPConnection | None = None

    def call(self, method: str, path: str, body: Mapping[str, object] | None = None) -> Any:  # noqa: ANN401 - JSON
        """Call the API; returns what is answered.

        Raises:
            RemoteMasterError: nobody answers, or it is no master.
            RemoteMasterRefusal: it refuses.
        """
        content = self.octets(method, path, body)
        try:
            return read_remote_json(content)
        except ValueError:
            raise _no_page(self._access.address) from None

    def octets(self, method: str, path: str, body: Mapping[str, object] | None = None) -> bytes:
        """The same, for calls that answer with something else.

        Raises:
            RemoteMasterError: nobody answers, or it is no master.
            RemoteMasterRefusal: it refuses.
        """
        where = self._access.address
        left = self._until - time.monotonic()
        if left <= 0:
            raise _too_late(where)
        headers = {"Authorization": f"Bearer {self._access.token}", "Content-Type": "application/json"}
        try:
            connection = self._connected(left)
            connection.request(method, path, None if body is None else json.dumps(body).encode(), headers)
            with connection.getresponse() as answer:
                content = answer.read(MOST_OCTETS + 1)
        except ssl.SSLCertVerificationError as error:
            words = said(
                "{address}: its certificate is not the one that is trusted here ({error}); if that is right, "
                "`msbot class join {address}` again",
                address=where,
                error=error.verify_message,
            )
            raise RemoteMasterError(words) from None
        except TimeoutError:
            raise _too_late(where) from None
        except http.client.RemoteDisconnected:
            raise RemoteMasterError(
                said("{address}: it ended the connection without an answer", address=where)
            ) from None
        except OSError as error:
            raise RemoteMasterError(
                said("{address}: {error}", address=where, error=error.strerror or type(error).__name__)
            ) from None
        except (http.client.HTTPException, ValueError):
            raise _no_page(where) from None
        if len(content) > MOST_OCTETS:
            raise _no_page(where)
        if answer.status == http.client.UNAUTHORIZED:
            words = said(
                "{address}: it does not know the API token (any more): `msbot class join {address}` with another one",
                address=where,
            )
            raise RemoteMasterRefusal(words)
        if answer.status != http.client.OK:
            why = _why(content) or f"{answer.status} {printable(answer.reason)}"
            words = said("{address}: {error}", address=where, error=why)
            if answer.status == http.HTTPStatus.LOCKED:
                raise RemoteMasterBusy(words)
            # A database that was too slow (409) may store it later, and nobody knows of a server's own fault (5xx).
            raise RemoteMasterRefusal(words) if answer.status in _NOTHING_CHANGED else RemoteMasterError(words)
        return content

    def mapping(self, method: str, path: str, body: Mapping[str, object] | None = None) -> Answer:
        """The same, for calls that answer with an object."""
        found = self.call(method, path, body)
        if not isinstance(found, dict):
            raise _no_page(self._access.address)
        return found

    def abort(self) -> None:
        """End whatever the thread waits for."""
        sock = None if self._connection is None else self._connection.sock
        if sock is not None:
            with suppress(OSError):
                sock.shutdown(socket.SHUT_RDWR)

    def close(self) -> None:
        """Give the connection back."""
        if self._connection is not None:
            self._connection.close()

    def _connected(self, timeout_s: float) -> http.client.HTTPConnection:
        if self._connection is None:
            found = urlsplit(self._access.address)
            host = found.hostname or ""
            self._connection = (
                http.client.HTTPSConnection(host, found.port, context=_trust(self._access.certificate))
                if found.scheme == "https"
                else http.client.HTTPConnection(host, found.port)
            )
        self._connection.timeout = timeout_s
        if self._connection.sock is not None:
            self._connection.sock.settimeout(timeout_s)
        return self._connection


Work = Callable[[RemoteMasterConnection, Callable[[_R], None]], None]
"""What is done at one master; it notes what it knows, each time it knows more."""


class ParallelRequest(Generic[_R]):
    """One question to many masters, which begins at once.

    Args:
        accesses: whom.
        work: what is done at each.
        limit_s: how long each has.
    """

    def __init__(self, accesses: Sequence[RemoteAccess], work: Work[_R], limit_s: float) -> None:
        self._until = time.monotonic() + limit_s
        self._lock = threading.Lock()
        self._known: dict[str, _R | RemoteMasterError] = {}
        self._lines = {access.address: RemoteMasterConnection(access, self._until) for access in accesses}
        self._threads = {
            address: threading.Thread(target=self._run, args=(address, line, work), name="msbot far", daemon=True)
            for address, line in self._lines.items()
        }
        for address, thread in self._threads.items():
            try:
                thread.start()
            except RuntimeError:
                words = said("{address}: this computer has no thread left to ask it", address=address)
                self._known[address] = RemoteMasterError(words)

    def answers(self) -> dict[str, _R | RemoteMasterError]:
        """By address: what is known of each when all have answered or their time is over."""
        for address, thread in self._threads.items():
            if thread.ident is not None:  # it was started
                thread.join(max(0.0, self._until - time.monotonic()))
            with self._lock:
                self._known.setdefault(address, _too_late(address))  # unless something is known
            if thread.is_alive():
                self._lines[address].abort()
        with self._lock:
            return dict(self._known)

    def unfinished(self) -> list[str]:
        """Addresses whose threads have not come to an end: they look a name up."""
        return [address for address, thread in self._threads.items() if thread.is_alive()]

    def _run(self, address: str, line: RemoteMasterConnection, work: Work[_R]) -> None:
        def note(found: _R) -> None:
            with self._lock:
                self._known[address] = found

        try:
            work(line, note)
        except RemoteMasterError as trouble:
            with self._lock:  # what is known already is worth more: STOP was taken, say
                self._known.setdefault(address, trouble)
        finally:
            line.close()


def ask_one(access: RemoteAccess, work: Callable[[RemoteMasterConnection], _R], limit_s: float) -> _R:
    """Speak to one master.

    Raises:
        RemoteMasterError: it does not answer in that time, or refuses.
    """

    def noted(line: RemoteMasterConnection, note: Callable[[_R], None]) -> None:
        note(work(line))

    (answer,) = ParallelRequest([access], noted, limit_s).answers().values()
    if isinstance(answer, RemoteMasterError):
        raise answer
    return answer


def read_status(line: RemoteMasterConnection, note: Callable[[Answer], None]) -> None:
    """What a master says of itself in short."""
    note(line.mapping("GET", "/api/status"))


def say_stop(reason: str, group: str = "") -> Work[Answer]:
    """STOP, and who has confirmed it.

    Args:
        reason: why.
        group: only if the robot is in this STOP group, of another one `{"stop_group": ...}` is noted and no more;
            empty: in any case.
    """

    def work(line: RemoteMasterConnection, note: Callable[[Answer], None]) -> None:
        if group and (other := line.mapping("GET", "/api/status").get("stop_group")) != group:
            note({"stop_group": other})
            return
        taken = line.mapping("POST", "/api/stop", {"reason": reason[:200]})
        stored = {"stored": taken.get("stored", True)}
        note({"stopped": True, "told": None, "silent": [], "not_confirmed": 0} | stored)  # more is not known yet
        until = time.monotonic() + CONFIRM_S
        while True:
            status = line.mapping("GET", "/api/status")
            note(status | stored)
            if not status.get("not_confirmed") or time.monotonic() > until:
                return
            time.sleep(AGAIN_S)

    return work


def _why(content: bytes) -> str:
    """The reason that an answer with an error gives; empty: none."""
    try:
        found = read_remote_json(content)
    except ValueError:
        return ""
    return str(found.get("error") or "") if isinstance(found, dict) else ""


def _too_late(address: str) -> RemoteMasterError:
    return RemoteMasterError(said("{address}: no answer in time", address=address))


def _no_page(address: str) -> RemoteMasterError:
    return RemoteMasterError(said("{address}: what answers there is no page of MsBOT", address=address))


@lru_cache(maxsize=8)  # to read the certificates of this computer takes 20 ms
def _trust(certificate: str) -> ssl.SSLContext:
    if not certificate:
        return ssl.create_default_context()
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
    context.check_hostname = False  # the certificate itself is what was agreed on, whatever name it bears
    context.verify_flags |= ssl.VERIFY_X509_PARTIAL_CHAIN
    context.load_verify_locations(cadata=certificate)
    return context
