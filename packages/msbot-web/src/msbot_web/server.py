"""Serves the pages and the API in the robot's own event loop: one process, one port, no thread.

NiceGUI (pages), FastAPI (API) and uvicorn (HTTP) do the work; this file puts them behind the guard, binds the socket
itself so that a port in use is a sentence and not a traceback, and ends with the robot.
"""

from __future__ import annotations

import asyncio
import contextlib
import errno
import hashlib
import json
import socket
import ssl
import time
from collections.abc import Callable, Iterator
from functools import partial
from importlib.resources import files
from pathlib import Path

import uvicorn
from fastapi import FastAPI
from starlette.requests import Request
from starlette.responses import HTMLResponse, PlainTextResponse, Response
from starlette.routing import BaseRoute
from starlette.staticfiles import StaticFiles

from msbot_agent.link.net import WebSocketServerLink
from msbot_agent.log import write_by_root_alone
from msbot_agent.pace import ConnectionPace, ProtocolServer
from msbot_agent.text.sentence import said
from msbot_agent.text.untrusted_input import LARGEST_PEM, read_input_file
from msbot_web.access.access_middleware import ANY_ADDRESS, HEALTH_PATH, STOP_PATH, AccessMiddleware, cookie_names
from msbot_web.access.content_policy import PASSING, refusal_page, sentence, wants_page
from msbot_web.access.reverse_proxies import ProxyHeadersMiddleware, TrustedProxies
from msbot_web.access.sign_in_pages import make_forms
from msbot_web.api.exception_handlers import add_exception_handlers
from msbot_web.api.health_route import make_health_api
from msbot_web.api.lazy_routes import LazyRoutes
from msbot_web.api.stop_route import make_stop_api
from msbot_web.api_rate_limit import ApiRateLimit
from msbot_web.connection_limits import HEAD_S, RESERVED, ConnectionLimits, LimitedConnection
from msbot_web.installable_page import make_installed
from msbot_web.known_addresses import KnownAddresses
from msbot_web.nicegui_internals.application import LOGGER, LazyWebSocket, serve_pages, set_ping, websocket_protocol
from msbot_web.nicegui_internals.open_pages import OpenPages
from msbot_web.nicegui_internals.page_admission import PageAdmission
from msbot_web.nicegui_internals.page_sockets import PageSockets
from msbot_web.page_errors import HandledErrors, limit_repeated_errors, somebody_waits
from msbot_web.pages import register_pages
from msbot_web.pages.handbook_pages import picture_answer
from msbot_web.part_websocket import PartWebSocket
from msbot_web.programs.browser_files import add_browser_files
from msbot_web.service import Service
from msbot_xrce.counting import Tally
from msbot_xrce.errors import ConfigError
from msbot_xrce.lazy import dataclass

STATIC = Path(str(files("msbot_web") / "static"))
DEFAULT_PORT = 8080
NEXT_PORTS = 20
"""Ports from that one on which are tried before any free one is taken."""
BACKLOG = 1024
"""Connections that the system keeps until we accept them; who finds no place tries again after 1, 3, 7 ... seconds."""
LOOPBACK = ("127.0.0.1", "localhost", "::1")
ANY_HOST = ("0.0.0.0", "::")
CONNECTIONS_OF_ADDRESS_S, CONNECTIONS_S = 60.0, 120.0
"""Connections a second from one address where nobody is signed in, and from all such addresses."""
LATE_PATHS = ("/api", "/openapi", "/metrics")
"""Of what is made when it is needed: the API, its description, and the page that shows it."""
MAX_MESSAGE = 1024 * 1024
"""Octets of one message of a websocket."""
MOST_MESSAGES = 4
"""Messages of one websocket that may have come and wait to be read."""
KEPT_S = 30.0
"""How long a page whose connection is lost is kept, as it was: with an open menu, what is being typed, and the rest."""
PING_S, PATIENCE_S = 4.0, 6.0
"""How often pages are asked whether they are there, and how long a busy or far one may take to answer."""


@dataclass(frozen=True, slots=True)
class WebSettings:
    """Where the pages are served."""

    host: str = "127.0.0.1"
    port: int = DEFAULT_PORT
    """0 = any free one."""
    or_any_port: bool = False
    """Take the next free port when this one is in use."""
    certificate: Path | None = None
    """PEM file with the certificate chain; with it the pages are served by TLS."""
    key: Path | None = None
    """PEM file with its private key; absent: in the same file."""
    names: tuple[str, ...] = ()
    """Further host names under which the page may be asked for; addresses and the computer's own name always are."""
    proxies: tuple[str, ...] = ()
    """Addresses and networks of reverse proxies whose word about a request counts."""
    place: str = ""
    """What browsers know the page by, whichever robot it shows; empty: by its robot."""
    open_set_up: bool = False
    """Whether whoever opens the page first becomes its administrator, without the link."""


DATE_S = 1.0
"""Period in which the date in the headers of answers is set."""


class _Server(uvicorn.Server):
    """Leaves signals to the command that runs the robot, and says when it is up."""

    def __init__(self, config: uvicorn.Config) -> None:
        super().__init__(config)
        self.ready = asyncio.Event()
        self._leaving = asyncio.Event()

    async def main_loop(self) -> None:
        """Keep the date of answers until `leave`; uvicorn itself would look ten times a second whether to end."""
        while not await self.on_tick(0):
            with contextlib.suppress(TimeoutError):
                async with asyncio.timeout(DATE_S):
                    await self._leaving.wait()

    def leave(self) -> None:
        """End, without waiting for anybody."""
        self.should_exit = self.force_exit = True
        self._leaving.set()

    async def startup(self, sockets: list[socket.socket] | None = None) -> None:  # noqa: ARG002 - uvicorn's signature
        await super().startup([])  # no socket for asyncio's own server: `ProtocolServer` looks after it
        set_ping(PING_S, PATIENCE_S)
        write_by_root_alone()  # uvicorn, socket.io and engine.io bring handlers of their own
        self.ready.set()

    def connection(self, connections: ConnectionLimits) -> LimitedConnection:
        """A new connection's protocol."""
        return LimitedConnection(connections, self.config, self.server_state, self.lifespan.state)

    @contextlib.contextmanager
    def capture_signals(self) -> Iterator[None]:
        yield


class WebServer:
    """The web pages of one robot. Only one can be made in a process: NiceGUI keeps its pages globally.

    Args:
        service: what the pages show and do.
        settings: where.

    Raises:
        ConfigError: the port is in use or not allowed, or the certificate cannot be used; the text says what to do.
    """

    def __init__(self, service: Service, settings: WebSettings) -> None:
        self._service = service
        self._place = settings.place
        self._known = KnownAddresses()
        self._proxies = TrustedProxies(settings.proxies)
        self.connections = ConnectionLimits(is_shared=self._proxies.trusts)
        self._tls = None if settings.certificate is None else _tls_context(settings.certificate, settings.key)
        self._socket = _bind(settings)
        self.host = settings.host
        self.port: int = self._socket.getsockname()[1]
        self.parts = WebSocketServerLink(self.own_address.replace("http", "ws", 1))
        """Parts that come in by the page; nobody but the robot makes it run."""
        try:
            self._server = _Server(self._config(settings))
        except BaseException:
            self._socket.close()
            raise

    @property
    def page_id(self) -> str:
        """Distinguishes this robot's page from others on this computer: eight hexadecimal digits."""
        whose = self._place or self._service.robot_id
        return hashlib.sha256(f"{whose}\n{self.port}".encode()).hexdigest()[:8]

    @property
    def ready(self) -> asyncio.Event:
        """Set when the pages can be opened."""
        return self._server.ready

    @property
    def address(self) -> str:
        """What a person types: `http://127.0.0.1:8080`."""
        return self._address("127.0.0.1" if self.host in ANY_HOST else self.host)

    @property
    def own_address(self) -> str:
        """Where it is served, as other masters of this computer are told: 0.0.0.0 for every network."""
        return self._address(self.host)

    def _address(self, host: str) -> str:
        host = f"[{host}]" if ":" in host else host
        return f"{'https' if self._tls else 'http'}://{host}:{self.port}"

    @property
    def link(self) -> str:
        """What is printed: the address, or the one-time set-up link, or the demo's link that signs one in."""
        accounts = self._service.accounts
        if accounts.has_entry_link:
            return f"{self.address}/enter?token={accounts.entry_token()}"
        if accounts.needs_setup:
            return f"{self.address}/setup?token={accounts.setup_token()}"
        return self.address

    async def run(self) -> None:
        """Serve until cancelled."""
        serving = asyncio.ensure_future(self._server.serve(sockets=[]))
        acceptor = ProtocolServer(
            self._socket,
            lambda: self._server.connection(self.connections),
            Tally(),
            tls=self._tls,
            handshake_s=HEAD_S,
            pace=ConnectionPace(CONNECTIONS_OF_ADDRESS_S, CONNECTIONS_S, self._known.knows, self._proxies.trusts),
            reserved=RESERVED,
            make_room=self.connections.make_room,
        )
        accepting = asyncio.ensure_future(self._accept(acceptor))
        showing = asyncio.ensure_future(self._service.live.run())
        try:
            await asyncio.shield(serving)
        finally:
            accepting.cancel()
            showing.cancel()
            self._server.leave()
            ending = asyncio.ensure_future(self._end(serving))
            while not ending.done():  # whoever is in a hurry and cancels twice does not tear it off half way
                with contextlib.suppress(asyncio.CancelledError):
                    await asyncio.shield(ending)
            self._socket.close()

    async def _accept(self, acceptor: ProtocolServer) -> None:
        await self.ready.wait()
        await acceptor.run()

    async def _end(self, serving: asyncio.Future[None]) -> None:
        await asyncio.wait([serving])
        if self.ready.is_set():
            # `force_exit` leaves this out, and what is left of the server ends in a traceback.
            await self._server.lifespan.shutdown()

    def _config(self, settings: WebSettings) -> uvicorn.Config:
        service = self._service
        app = FastAPI(title="MsBOT", version="1", docs_url=None, redoc_url=None, openapi_url="/openapi.json")
        cookies = cookie_names(self.page_id)
        app.include_router(
            make_forms(
                service.accounts,
                service.robot_name,
                cookies,
                service.pupils.passes,
                is_open=settings.open_set_up,
                is_on_card=lambda: service.is_on_card,
            )
        )
        app.include_router(make_stop_api(service))
        app.include_router(make_health_api())
        app.include_router(make_installed(service.robot_name))
        at_once = (STOP_PATH, HEALTH_PATH)
        app.add_middleware(LazyRoutes, of=app, paths=LATE_PATHS, make=partial(_lazy_routes, service), but=at_once)
        add_browser_files(app)
        app.router.routes.append(PartWebSocket(self.parts, service.accounts).route())
        app.router.routes.append(service.live.route())
        add_exception_handlers(app)
        app.mount("/web", StaticFiles(directory=STATIC), name="web")
        app.add_api_route("/handbook/pictures/{name:path}", picture_answer, include_in_schema=False)
        register_pages(service)
        serve_pages(
            app,
            title=f"{service.robot_name} · MsBOT",
            icon=STATIC / "icon.svg",
            kept_s=KEPT_S,
            not_there=_not_there,
            failed=_failed,
        )
        pages = OpenPages(service.accounts)
        limit_repeated_errors()
        guard = AccessMiddleware(
            ApiRateLimit(PageSockets(PageAdmission(HandledErrors(app, LOGGER))), LATE_PATHS, STOP_PATH, time.monotonic),
            service.accounts,
            _names_of(settings),
            cookies=cookies,
            owns=pages.may_use,
            beat=lambda: json.dumps({"stopped": service.is_stopped}).encode(),
            is_tls=self._tls is not None,
            api=app,
            signed_in=self._known.note,
        )
        return uvicorn.Config(
            ProxyHeadersMiddleware(guard, self._proxies),
            log_config=None,  # its own handlers would write past the robot's, which bounds what strangers can cause
            log_level="warning",
            access_log=False,
            server_header=False,
            lifespan="on",
            timeout_graceful_shutdown=1,
            proxy_headers=False,  # `ProxyHeadersMiddleware` reads them
            ws=LazyWebSocket,
            ws_max_size=MAX_MESSAGE,
            ws_max_queue=MOST_MESSAGES,
        )


def _lazy_routes(service: Service) -> list[BaseRoute]:
    websocket_protocol()  # the first page asks for one next
    from msbot_web.api.admin_routes import make_admin_api, make_metrics
    from msbot_web.api.operation_routes import brought_routers
    from msbot_web.api.routes import make_api

    routers = (make_api(service), make_admin_api(service), make_metrics(service), *brought_routers(service))
    return [route for router in routers for route in router.routes]


async def _not_there(request: Request, _error: Exception) -> Response:
    return _refusal(request, 404, said("there is no such page"))


async def _failed(request: Request, error: Exception) -> Response:
    """A page that cannot be made; NiceGUI's own one would have neither STOP nor a way back."""
    if await somebody_waits(request):  # else that is why
        LOGGER.error("a page could not be made", exc_info=error)
    return _refusal(request, 500, said("this page could not be made: the robot's log says why"))


def _refusal(request: Request, status: int, words: str) -> Response:
    if not wants_page(request.scope):
        return PlainTextResponse(sentence(words), status)
    session = request.scope.get("state", {}).get("session")
    return HTMLResponse(refusal_page(request.scope, words, session=session, comes_back=status in PASSING), status)


def _names_of(settings: WebSettings) -> tuple[str, ...]:
    """The host names that the page answers to; a hostile site's name that leads here gets no answer."""
    if settings.host in LOOPBACK:
        return (*LOOPBACK, *settings.names)
    own = socket.gethostname()
    short = own.partition(".")[0]
    return (*LOOPBACK, ANY_ADDRESS, settings.host, own, short, f"{short}.local", socket.getfqdn(), *settings.names)


def _bind(settings: WebSettings) -> socket.socket:
    family = socket.AF_INET6 if ":" in settings.host else socket.AF_INET
    bound = socket.socket(family, socket.SOCK_STREAM)
    try:
        bound.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            bound.bind((settings.host, settings.port))
        except OSError as error:
            if error.errno != errno.EADDRINUSE or not settings.or_any_port:
                raise
            _bind_beside(bound, settings)
        bound.listen(BACKLOG)
        bound.setblocking(False)
    except OSError as error:
        bound.close()
        raise ConfigError(_why_not(error, settings)) from None
    except UnicodeError:
        bound.close()
        raise ConfigError(_why_not(socket.gaierror(), settings)) from None
    return bound


def _bind_beside(bound: socket.socket, settings: WebSettings) -> None:
    """Take the next free port, so that a robot has the same address after a restart; if all are taken, any one."""
    for port in range(settings.port + 1, min(settings.port + NEXT_PORTS, 0x10000)):
        try:
            bound.bind((settings.host, port))
        except OSError as error:
            if error.errno != errno.EADDRINUSE:
                raise
        else:
            return
    bound.bind((settings.host, 0))


def _why_not(error: OSError, settings: WebSettings) -> str:
    where = f"the page cannot be served on {settings.host} port {settings.port}"
    if error.errno == errno.EADDRINUSE:
        return f"{where}: another program uses it; choose another one with --port, or --port 0 for any free one"
    if error.errno == errno.EACCES:
        return f"{where}: ports below 1024 need more rights; choose one from 1024 up with --port"
    if isinstance(error, socket.gaierror) or error.errno == errno.EADDRNOTAVAIL:
        return f"{where}: this computer has no such address; use --host 127.0.0.1, or 0.0.0.0 for all its networks"
    return f"{where}: {error.strerror}"


def _tls_context(certificate: Path, key: Path | None) -> ssl.SSLContext:
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    try:
        for file in (certificate, key):
            if file is not None:
                read_input_file(file, LARGEST_PEM, "a PEM file")
        context.load_cert_chain(certificate, key, _no_password(key or certificate))
    except ssl.SSLError as error:
        raise ConfigError(
            f"the certificate {certificate} and the key {key or certificate} do not go together, or are no PEM files "
            f"({error.reason or error})"
        ) from None
    except OSError as error:
        raise ConfigError(f"cannot read {error.filename or certificate}: {error.strerror}") from None
    return context


def _no_password(key: Path) -> Callable[[], str]:
    def refuse() -> str:
        # Asked for at the terminal it would keep the robot from starting.
        raise ConfigError(f"the key {key} is protected by a password: `openssl pkey -in {key} -out FILE` takes it away")

    return refuse
