"""The connection to a broker, in the event loop: it reconnects, and STOP does not wait behind other orders."""

from __future__ import annotations

import asyncio
import contextlib
import logging
import ssl
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Any, Self
from urllib.parse import unquote, urlsplit

import aiomqtt

from msbot_agent.text.untrusted_input import read_input_file
from msbot_xrce.errors import ConfigError, LinkDown
from msbot_xrce.lazy import dataclass

KEEP_ALIVE_S = 10
"""After one and a half of this without a sign of life the broker tells others that this client is lost."""
CONNECT_S = 10.0
AGAIN_S = (0.5, 1.0, 2.0, 5.0, 10.0)
"""Time between attempts to connect again; the last one holds."""
LEAVE_S = 2.0
"""Longest time to hand the last messages to a broker."""
MOST_TOPICS = 5000
"""Topics for which something waits to be sent, and topics that are subscribed to."""
MOST_URGENT = 500
MOST_PASSWORD = 4096
"""Bytes of a file with a password."""
MOST_IN = 10_000
"""Messages that wait to be read; beyond, the library drops what comes."""
LONGEST_PAYLOAD = 65_536

_log = logging.getLogger("msbot.part")
Heard = Callable[[str, bytes, bool], None]
"""Topic, payload, and whether it is an old message that the broker had kept."""


@dataclass(frozen=True, slots=True)
class BrokerAddress:
    """Where a broker is, and as whom one connects."""

    host: str
    port: int
    user: str | None = None
    password: str | None = None
    is_tls: bool = False
    ca: str | None = None

    @property
    def words(self) -> str:
        """For people, without a password."""
        return f"{'mqtts' if self.is_tls else 'mqtt'}://{self.host}:{self.port}"


def read_address(text: str, options: Mapping[str, str]) -> BrokerAddress:
    """Read `mqtt://[USER@]HOST[:PORT]`, `mqtts://...`, or `broker:PORT` for a broker of MsBOT's own.

    Args:
        text: the address.
        options: `password_file`, `ca`.

    Raises:
        ConfigError: it is no such address, or a file cannot be read.
    """
    wrong = ConfigError(
        f"--link {text}: write mqtt://HOST, mqtt://USER@HOST:PORT, mqtts:// with TLS, or broker:PORT for a small "
        "broker that runs with the bridge (broker:0: at any port that is free)"
    )
    if (own := own_port(text)) is not None:
        return BrokerAddress("127.0.0.1", own)
    parts = urlsplit(text)
    if parts.scheme not in ("mqtt", "mqtts") or not parts.hostname or parts.path.strip("/") or parts.query:
        raise wrong
    try:
        port = parts.port
    except ValueError:
        raise wrong from None
    if parts.password is not None:
        raise ConfigError(
            "a password in an address is seen by others: write it into a file, --option password_file=FILE"
        )
    password = None
    if file := options.get("password_file"):
        try:
            password = read_input_file(Path(file), MOST_PASSWORD, "a password").decode().strip()
        except (OSError, UnicodeDecodeError) as error:
            raise ConfigError(f"--option password_file={file} cannot be read: {error}") from error
    is_tls = parts.scheme == "mqtts"
    ca = options.get("ca")
    if ca and not Path(ca).is_file():
        raise ConfigError(f"--option ca={ca}: there is no such file")
    user = unquote(parts.username) if parts.username else None
    return BrokerAddress(parts.hostname, port or (8883 if is_tls else 1883), user, password, is_tls, ca)


def own_port(text: str) -> int | None:
    """The port of a broker of MsBOT's own, `broker:PORT`; None: the address is another's."""
    scheme, _, port = text.partition(":")
    is_port = scheme == "broker" and port.isdecimal() and int(port) < 65_536
    return int(port) if is_port else None


@dataclass(frozen=True, slots=True)
class LastWill:
    """What the broker publishes, retained, when this client is lost."""

    topic: str
    payload: str


class _Client(aiomqtt.Client):
    """The library's client. How its connection has ended is also taken when it ends while this client is leaving, and
    when it ends with the octets that acknowledge it, which the library takes for the end of a connection before."""

    async def __aenter__(self) -> Self:
        await super().__aenter__()
        if self._client.socket() is None:
            raise aiomqtt.MqttError("it has ended the connection as soon as it was there")
        return self

    async def __aexit__(self, *reason: Any) -> None:  # noqa: ANN401 - as the library has it
        await super().__aexit__(*reason)
        if self._disconnected.done() and not self._disconnected.cancelled():
            self._disconnected.exception()


class Broker:
    """One client of a broker.

    Args:
        address: where it is.
        on_message: called for each message.
        on_connected: called each time the connection is there.
        on_lost: called with the reason each time it is gone.
        on_leaving: called before this client leaves; what it publishes is sent. A broker does not tell the will of a
            client that has left by itself.
        on_dropped: called each time something was left out.
        will: told to others when this client is lost.
    """

    def __init__(
        self,
        address: BrokerAddress,
        *,
        on_message: Heard,
        on_connected: Callable[[], None] = lambda: None,
        on_lost: Callable[[str], None] = lambda _: None,
        on_leaving: Callable[[], None] = lambda: None,
        on_dropped: Callable[[], None] = lambda: None,
        will: LastWill | None = None,
    ) -> None:
        self.dropped = 0
        """Messages that were too long or found no room."""
        self.address = address
        self._on_message, self._on_connected, self._on_lost = on_message, on_connected, on_lost
        self._on_leaving, self._on_dropped = on_leaving, on_dropped
        self._will = will
        self._wanted: dict[str, bool] = {}
        """Topics that are subscribed to; False: not yet."""
        self._unwanted = set[str]()
        self._waiting: dict[str, tuple[str, bool]] = {}
        self._urgent = set[asyncio.Task[None]]()
        self._client: aiomqtt.Client | None = None
        self._work = asyncio.Event()

    async def run(self) -> None:
        """Stay connected until cancelled.

        Raises:
            LinkDown: the broker could not be reached the first time, or refuses this client.
        """
        attempt, was_there = 0, False
        while True:
            try:
                async with self._new_client() as client:
                    self._client, attempt, was_there = client, 0, True
                    self._wanted = dict.fromkeys(self._wanted, False)
                    self._work.set()
                    self._on_connected()
                    sending = asyncio.create_task(self._send(client))
                    try:
                        await self._listen(client)
                    except asyncio.CancelledError:
                        self._on_leaving()
                        with contextlib.suppress(TimeoutError):
                            async with asyncio.timeout(LEAVE_S):
                                await self.flush()
                        raise
                    finally:
                        sending.cancel()
                        await asyncio.wait([sending])
                        if not sending.cancelled() and (error := sending.exception()) is not None:
                            raise error
            except (aiomqtt.MqttError, OSError) as error:
                if not was_there:
                    raise LinkDown(f"{self.address.words}: {_reason(error)}; does the broker run there?") from error
                if self._client is not None:
                    self._on_lost(f"the broker is gone: {_reason(error)}")
            finally:
                self._client = None
            await asyncio.sleep(AGAIN_S[min(attempt, len(AGAIN_S) - 1)])
            attempt += 1

    def _new_client(self) -> aiomqtt.Client:
        address, will = self.address, self._will
        context = None
        if address.is_tls:
            context = ssl.create_default_context(cafile=address.ca)
        return _Client(
            address.host,
            address.port,
            username=address.user,
            password=address.password,
            tls_context=context,
            keepalive=KEEP_ALIVE_S,
            timeout=CONNECT_S,
            max_queued_incoming_messages=MOST_IN,
            max_queued_outgoing_messages=MOST_TOPICS,
            will=None if will is None else aiomqtt.Will(will.topic, will.payload, qos=1, retain=True),
        )

    async def _listen(self, client: aiomqtt.Client) -> None:
        async for message in client.messages:
            payload = message.payload
            if not isinstance(payload, bytes) or len(payload) > LONGEST_PAYLOAD:
                self._drop()
                continue
            self._on_message(message.topic.value, payload, message.retain)

    async def _send(self, client: aiomqtt.Client) -> None:
        """Send what waits, until the connection is gone; then `_listen` says so."""
        with contextlib.suppress(aiomqtt.MqttError):
            while True:
                self._work.clear()
                if unwanted := [topic for topic in self._unwanted if topic not in self._wanted]:
                    self._unwanted.clear()
                    await client.unsubscribe(unwanted)
                if new := [topic for topic, is_done in self._wanted.items() if not is_done][:100]:
                    await client.subscribe([(topic, 1) for topic in new])
                    self._wanted.update(dict.fromkeys((topic for topic in new if topic in self._wanted), True))
                    self._work.set()
                while self._waiting:
                    topic = next(iter(self._waiting))
                    payload, is_kept = self._waiting.pop(topic)
                    await client.publish(topic, payload, qos=0, retain=is_kept)
                await self._work.wait()

    def _drop(self) -> None:
        self.dropped += 1
        self._on_dropped()

    # From the loop

    @property
    def is_connected(self) -> bool:
        """Whether the broker is there."""
        return self._client is not None

    def subscribe(self, topics: Iterable[str]) -> None:
        """Hear these topics, also after a new connection."""
        for topic in topics:
            if topic not in self._wanted and len(self._wanted) >= MOST_TOPICS:
                self._drop()
                continue
            self._wanted.setdefault(topic, False)
        self._work.set()

    def unsubscribe(self, topics: Iterable[str]) -> None:
        """Hear these topics no longer."""
        for topic in topics:
            if self._wanted.pop(topic, None) is not None:
                self._unwanted.add(topic)
        self._work.set()

    def publish(self, topic: str, payload: str, *, is_kept: bool = False) -> None:
        """Send a message soon; a newer one for the same topic takes its place.

        Args:
            topic: where to.
            payload: the message.
            is_kept: the broker keeps it for those who come later.
        """
        if topic not in self._waiting and len(self._waiting) >= MOST_TOPICS:
            self._waiting.pop(next(iter(self._waiting)))
            self._drop()
        self._waiting.pop(topic, None)
        self._waiting[topic] = (payload, is_kept)
        self._work.set()

    def publish_urgently(self, topic: str, payload: str) -> None:
        """Send a message at once, before all others, and have the broker acknowledge it."""
        self._waiting.pop(topic, None)  # what came before it must not come after it
        client = self._client
        if client is None:
            return  # nobody is there; devices of a broker that is gone are lost
        if len(self._urgent) >= MOST_URGENT:
            self._drop()
            return

        async def send() -> None:
            with contextlib.suppress(aiomqtt.MqttError):
                await client.publish(topic, payload, qos=1)

        task = asyncio.get_running_loop().create_task(send())
        self._urgent.add(task)
        task.add_done_callback(self._urgent.discard)

    async def flush(self) -> None:
        """Wait until what is to be sent has been handed to the broker, as far as it is there."""
        client = self._client
        while client is not None and self._waiting:
            topic = next(iter(self._waiting))
            payload, is_kept = self._waiting.pop(topic)
            try:
                await client.publish(topic, payload, qos=1, retain=is_kept)
            except aiomqtt.MqttError as error:
                _log.debug("%s: %s", self.address.words, error)
                return


def _reason(error: BaseException) -> str:
    cause = error.__cause__
    return str(cause or error) or type(error).__name__
