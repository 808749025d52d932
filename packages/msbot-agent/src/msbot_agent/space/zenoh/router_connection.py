"""The connection to a router, and the one thread that waits for it.

Opening a session waits for the network, and so may making an endpoint; both happen in a thread of their own, in the
order in which they were asked for. Once it is open the library connects again by itself, and repeats to the router
what was made.
"""

from __future__ import annotations

import asyncio
import logging
import queue
import socket
import ssl
import threading
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, TypeAlias

from msbot_agent.space.network_options import TlsFiles
from msbot_agent.space.zenoh.sample_envelope import call_on_loop
from msbot_agent.space.zenoh.zenoh_library import load, session_config
from msbot_agent.text.untrusted_input import LARGEST_PEM, read_input_file
from msbot_xrce.errors import ConfigError

if TYPE_CHECKING:
    import zenoh


# Why a router cannot be reached, in a sentence: the library itself only says that it cannot.


PATIENCE_S = 3.0
"""How long a connection may take."""
VERDICT_S = 0.5
"""How long the other end may take to refuse our certificate after the handshake (TLS 1.3)."""

_THEIRS = "its certificate is not accepted here"
_OURS = "it does not accept our certificate, or wants one"


def check_files(tls: TlsFiles) -> None:
    """Read the certificates.

    Raises:
        ConfigError: one of them cannot be used; the text names the file.
    """
    context(tls)


def context(tls: TlsFiles) -> ssl.SSLContext:
    """The certificates as Python's TLS takes them.

    Raises:
        ConfigError: one of them cannot be used.
    """
    for file in (tls.ca, tls.certificate, tls.key):
        if file is not None:
            try:
                read_input_file(file, LARGEST_PEM, "a PEM file")
            except OSError as error:
                raise ConfigError(f"{file}: cannot be read ({error.strerror}); it should be a PEM file") from None
    try:
        made = ssl.create_default_context(cafile=str(tls.ca))
    except ssl.SSLError:
        raise ConfigError(f"{tls.ca}: is no certificate in PEM form") from None
    # Python 3.13 asks more of a certificate (a key usage, RFC 5280) than Zenoh's library does, whose view is told.
    made.verify_flags &= ~ssl.VERIFY_X509_STRICT
    if tls.certificate is not None and tls.key is not None:
        try:
            made.load_cert_chain(tls.certificate, tls.key)
        except ssl.SSLError as error:
            differ = "MISMATCH" in str(error)
            what = "do not belong together" if differ else "are no certificate and its key in PEM form"
            raise ConfigError(f"{tls.certificate} and {tls.key}: {what}") from None
    return made


def unreachable(endpoint: str, tls: TlsFiles | None) -> str:
    """Why no session with the router can be opened; empty: one was, and is closed again. Waits for the network.

    Raises:
        ConfigError: the library is not here.
    """
    library = load()
    try:
        library.open(session_config("client", connect=[endpoint], tls=tls)).close()
    except library.ZError:
        return why_not(endpoint, tls)
    return ""


def why_not(endpoint: str, tls: TlsFiles | None) -> str:
    """Try the endpoint, and say what is in the way. Waits for the network: not for the event loop."""
    kind, _, place = endpoint.partition("/")
    host, _, port = place.rpartition(":")
    host = host.strip("[]")
    try:
        with socket.create_connection((host, int(port)), PATIENCE_S) as connection:
            if kind == "tls" and tls is not None:
                return _why_not_tls(connection, host, tls)
    except ConfigError as error:
        return str(error)
    except OSError as error:
        return error.strerror or "it does not answer"
    return "it answers, but not as a Zenoh router: is that address right, and is it tcp/ or tls/?"


def _why_not_tls(connection: socket.socket, host: str, tls: TlsFiles) -> str:
    try:
        with context(tls).wrap_socket(connection, server_hostname=host) as secure:
            secure.settimeout(VERDICT_S)
            secure.recv(1)
    except ssl.SSLCertVerificationError as error:
        return f"{_THEIRS}: {error.verify_message}"
    except TimeoutError:
        pass  # it has accepted us, and waits for us to say something
    except (ssl.SSLError, ConnectionError) as error:
        return f"{_OURS}: {_reason(error)}"
    return "it answers, but not as a Zenoh router"


def _reason(error: OSError) -> str:
    if isinstance(error, ssl.SSLError) and error.reason:
        return error.reason.replace("_", " ").lower()
    return error.strerror or "it hung up"


FIRST_PAUSE_S = 0.5
LONGEST_PAUSE_S = 5.0
"""Between two attempts to reach a router for the first time."""
GOODBYE_S = 2.0
"""The longest time that leaving may take."""

Job: TypeAlias = "Callable[[zenoh.Session], None]"
"""Something to do with the session, in the thread."""

logger = logging.getLogger(__name__)


class RouterConnection:
    """A session with one of several routers. Must be made on the loop, and closed."""

    def __init__(self, routers: Sequence[str], tls: TlsFiles | None, on_change: Callable[[], None]) -> None:
        """Begin to connect.

        Args:
            routers: endpoints, of which the first that answers is used.
            tls: certificates.
            on_change: called on the loop when a router is there or lost, see `is_up`.
        """
        self.words = ", ".join(routers)
        self.is_up = False
        """Whether there is a router now."""
        self._routers = tuple(routers)
        self._tls = tls
        self._library = load()
        self._config = session_config("client", connect=routers, tls=tls)
        self._on_change = on_change
        self._loop = asyncio.get_running_loop()
        self._jobs: queue.SimpleQueue[Job | None] = queue.SimpleQueue()
        self._stopping = threading.Event()
        self._was_up = False
        self._thread = threading.Thread(target=self._run, name="msbot-zenoh", daemon=True)
        self._thread.start()

    def do(self, job: Job) -> None:
        """Have something done with the session as soon as there is one, after what was asked for before."""
        self._jobs.put(job)

    def close(self) -> None:
        """Leave; what was asked for and is not done is forgotten."""
        self._stopping.set()
        self._jobs.put(None)
        self._thread.join(GOODBYE_S)

    def _run(self) -> None:
        session = self._open()
        if session is None:
            return
        listener = session.info.declare_transport_events_listener(
            self._library.handlers.Callback(self._transport_changed, indirect=False), history=True
        )
        try:
            while (job := self._jobs.get()) is not None and not self._stopping.is_set():
                try:
                    job(session)
                except self._library.ZError as error:
                    call_on_loop(self._loop, logger.warning, "Zenoh refuses an endpoint: %s", str(error))
        finally:
            listener.undeclare()
            session.close()

    def _open(self) -> zenoh.Session | None:
        pause, said = FIRST_PAUSE_S, ""
        while not self._stopping.is_set():
            try:
                opened: zenoh.Session = self._library.open(self._config)
            except self._library.ZError:
                reasons = [f"{router} ({why_not(router, self._tls)})" for router in self._routers]
                sentence = f"no Zenoh router at {', '.join(reasons)}; it is tried again until it answers"
            else:
                return opened
            if sentence != said:
                call_on_loop(self._loop, logger.warning, "%s", sentence)
                said = sentence
            self._stopping.wait(pause)
            pause = min(2 * pause, LONGEST_PAUSE_S)
        return None

    def _transport_changed(self, event: zenoh.TransportEvent) -> None:
        call_on_loop(self._loop, self._changed, event.kind == self._library.SampleKind.PUT)

    def _changed(self, is_up: bool) -> None:
        if is_up == self.is_up or self._stopping.is_set():
            return
        self.is_up = is_up
        if not is_up:
            logger.warning("the Zenoh router at %s is lost; it is tried again until it answers", self.words)
        elif self._was_up:
            logger.warning("the Zenoh router at %s is heard again", self.words)
        self._was_up = True
        self._on_change()
