"""`ws:` and `wss:`: a part's way to its master through the page's server, where nothing but HTTP gets through.

One WebSocket, reopened whenever it breaks, with one binary message per packet. It presents an API token, as programs
do. A text message from the server is a sentence for a person.
"""

from __future__ import annotations

import asyncio
import contextlib
import logging
import os
from collections import deque
from typing import TYPE_CHECKING
from urllib.parse import urlsplit

from msbot_agent.link.base import BaseLink
from msbot_agent.link.byte_frames import MAX_PACKET
from msbot_agent.link.contract import LinkInfo, Peer, Signal
from msbot_xrce.errors import ConfigError, LinkDown, LinkFull

if TYPE_CHECKING:
    from websockets.asyncio.client import ClientConnection

_log = logging.getLogger(__name__)

PART_PATH = "/api/link"
"""Path at which the page's server accepts parts."""
TOKEN_VARIABLE = "MSBOT_TOKEN"
WRITE_LIMIT = 64 * 1024
"""Octets that may wait here, in addition to those in the system."""
RECONNECT_S = 0.5
CONNECT_S = 5.0
CLOSE_S = 1.0
REFUSED = 4400
"""Codes from here to 4499: the server does not want this part, and says why."""
_SHOWN = 300
"""How many characters of a sentence from the server are shown."""


class WebSocketClientLink(BaseLink):
    """Keeps one connection to a page's server, its `remote`. Satisfies `Link`.

    LINK_UP and LINK_DOWN say when the connection opens and breaks. A server that is not there is tried again; one that
    refuses the part ends the link with its reason.

    Args:
        address: `ws://HOST:PORT` or `wss://HOST:PORT`, with another path where a proxy wants one.
        token: an API token of a person who may play with parts.
    """

    def __init__(self, address: str, token: str) -> None:
        parts = urlsplit(address)
        self._url = address if parts.path not in ("", "/") else f"{parts.scheme}://{parts.netloc}{PART_PATH}"
        super().__init__(
            LinkInfo(f"{parts.scheme}://{parts.netloc}", MAX_PACKET, sparse_acknacks=True), remote=parts.netloc
        )
        self._token = token
        self._waiting: deque[bytes] = deque()
        self._octets = 0
        self._was_full = False
        self._more = asyncio.Event()
        self._connection: ClientConnection | None = None

    def has_room(self, peer: Peer) -> bool:  # noqa: ARG002 - there is only one
        """See `Link`; False while there is no connection."""
        return self._connection is not None and self._octets < WRITE_LIMIT

    def send(self, packet: bytes, peer: Peer) -> None:
        """Hand over one packet; never blocks.

        Raises:
            LinkFull: too much waits already.
            LinkDown: there is no connection.
        """
        if self._connection is None:
            raise LinkDown(f"{self.info.name}: there is no connection with the page")
        if self._octets >= WRITE_LIMIT:
            self._was_full = True
            raise LinkFull(f"{self.info.name}: the page does not take its data")
        self._waiting.append(packet)
        self._octets += len(packet)
        self._was_full = self._octets >= WRITE_LIMIT
        self._more.set()
        self._sent(packet, peer, asyncio.get_running_loop().time())

    def describe(self, peer: Peer) -> str:  # noqa: ARG002 - there is only one
        """The server's host and port."""
        return str(self.remote)

    async def run(self) -> None:
        """Keep the connection until cancelled; it may run again afterwards.

        Raises:
            LinkDown: the server refuses this part, or is not a server of MsBOT; or the library is not installed.
        """
        import ssl  # a Python in a browser has none, and all links are imported there

        try:
            from websockets.asyncio.client import connect
            from websockets.exceptions import InvalidHandshake, InvalidProxy, InvalidProxyStatus, InvalidStatus
        except ImportError:
            raise LinkDown("links by WebSocket need the library websockets: pip install 'msbot-agent[ws]'") from None
        while True:
            refusal = ""
            try:
                async with connect(
                    self._url,
                    additional_headers={"Authorization": f"Bearer {self._token}"},
                    compression=None,
                    max_size=MAX_PACKET,
                    open_timeout=CONNECT_S,
                    close_timeout=CLOSE_S,
                    write_limit=WRITE_LIMIT,
                ) as connection:
                    refusal = await self._serve(connection)
            except InvalidStatus as error:
                self._judge(error.response.status_code)
            except InvalidProxyStatus as error:
                self._judge_proxy(error.response.status_code)
            except InvalidProxy as error:
                raise LinkDown(f"{self.info.name}: {error}: check http_proxy and https_proxy") from None
            except ssl.SSLCertVerificationError as error:
                raise LinkDown(
                    f"{self.info.name}: its certificate is not trusted here ({error.verify_message}): name the file "
                    "with it in SSL_CERT_FILE"
                ) from None
            except (OSError, TimeoutError, EOFError, InvalidHandshake) as error:
                _log.debug("%s: no connection: %s", self.info.name, error)
            if refusal:
                raise LinkDown(f"{self.info.name}: {refusal}")
            await asyncio.sleep(RECONNECT_S)

    def _judge(self, status: int) -> None:
        """Handle a refusal to open a WebSocket; errors that may be transient are retried."""
        if status in (401, 403):
            raise LinkDown(
                f"{self.info.name}: the page does not let this part in: ${TOKEN_VARIABLE} has to hold an API token of "
                "a student or teacher (the page's Admin, API tokens), and the address has to be one that msbot prints"
            )
        if status < 500:
            raise LinkDown(f"{self.info.name}: there is no page of MsBOT; copy the address that msbot master prints")
        _log.debug("%s: no connection: HTTP status %d", self.info.name, status)

    def _judge_proxy(self, status: int) -> None:
        """Handle a refusal by the proxy on the way; one that cannot reach the page (5xx) is tried again."""
        if status < 500:
            wants = (
                "wants a name and a password (http://NAME:PASSWORD@HOST:PORT)" if status == 407 else "refuses the way"
            )
            raise LinkDown(
                f"{self.info.name}: the proxy {wants}, HTTP status {status}: check http_proxy and https_proxy, or name "
                "the page's host in no_proxy"
            )
        _log.debug("%s: the proxy has no connection: HTTP status %d", self.info.name, status)

    async def _serve(self, connection: ClientConnection) -> str:
        """Carry packets until the connection ends; returns why the server does not want this part, or ""."""
        from websockets.exceptions import ConnectionClosed

        loop = asyncio.get_running_loop()
        self._connection = connection
        self._signal_handler(Signal.LINK_UP, self.remote, "connected", loop.time())
        writing = loop.create_task(self._write(connection))
        try:
            async for message in connection:
                if isinstance(message, bytes):
                    self._received(message, self.remote, loop.time())
                else:
                    _log.warning("the page says: %s", " ".join(message[:_SHOWN].split()))
        except ConnectionClosed:
            pass  # its code and reason are examined below
        finally:
            writing.cancel()
            self._connection = None
            self._waiting.clear()
            self._octets = 0
            words = f"connection closed: {connection.close_reason or connection.close_code or 'broken'}"
            self._signal_handler(Signal.LINK_DOWN, self.remote, words, loop.time())
            await asyncio.wait([writing])  # not `await writing`: whoever cancels us just now must not be overheard
        is_refused = REFUSED <= (connection.close_code or 0) < REFUSED + 100
        return (connection.close_reason or "the page has ended the connection") if is_refused else ""

    async def _write(self, connection: ClientConnection) -> None:
        from websockets.exceptions import ConnectionClosed

        with contextlib.suppress(ConnectionClosed):  # the reader reports it
            while True:
                while not self._waiting:
                    self._more.clear()
                    await self._more.wait()
                packet = self._waiting[0]
                await connection.send(packet)
                self._waiting.popleft()
                self._octets -= len(packet)
                if self._was_full and not self._waiting:
                    self._was_full = False
                    self._room_handler(self.remote)


def open_websocket(address: str) -> WebSocketClientLink:
    """A part's end for `ws://HOST:PORT` or `wss://HOST:PORT`; the API token comes from the environment.

    Raises:
        ConfigError: the address or the token makes no sense.
    """
    try:
        parts = urlsplit(address)
        host, port = parts.hostname, parts.port
    except ValueError:
        host, port = None, None
    if not host or port == 0 or not address.partition(":")[2].startswith("//"):
        raise ConfigError("it needs // and the page's host and port")
    if parts.username or parts.query or parts.fragment:
        raise ConfigError("it has a host, a port and perhaps a path, and nothing else")
    token = os.environ.get(TOKEN_VARIABLE, "").strip()
    if not token or not token.isascii() or not token.isprintable():
        raise ConfigError(
            f"${TOKEN_VARIABLE} has to hold an API token of a student or teacher (the page's Admin, API tokens)"
        )
    return WebSocketClientLink(address, token)
