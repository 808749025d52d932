"""What depends on NiceGUI's inside is in one folder, and is there in the version that is installed."""

from __future__ import annotations

import ast
import asyncio
import gc
import inspect
import tomllib
import weakref
from importlib.metadata import version
from pathlib import Path
from typing import Literal

import engineio
import pytest
import socketio
from nicegui import Client, client, core, ui
from nicegui.middlewares import RedirectWithPrefixMiddleware
from nicegui.outbox import Outbox
from nicegui.page import page as page_builder
from packaging.requirements import Requirement
from starlette.requests import Request

from msbot.process.virtual_time import run_virtual
from msbot_web import nicegui_internals, server
from msbot_web.nicegui_internals.deleted_elements import free_deleted_elements
from msbot_web.nicegui_internals.outboxes import let_outboxes_sleep
from tools.sources import ROOT, source_files

FOLDER = Path(nicegui_internals.__file__).parent
OFFERED = {"nicegui": {"ui", "Client"}, "nicegui.events": None, "nicegui.version": {"__version__"}}
"""What NiceGUI offers to everybody, and may be used anywhere; None: all of a module."""
PROJECT = tomllib.loads((ROOT / "packages/msbot-web/pyproject.toml").read_text())["project"]


def test_only_the_folder_uses_what_is_inside_nicegui() -> None:
    outside = []
    for path in source_files():
        text = path.read_text()
        if "nicegui" not in text or path.is_relative_to(FOLDER):
            continue
        tree = ast.parse(text)
        types = [one for one in tree.body if isinstance(one, ast.If) and ast.unparse(one.test) == "TYPE_CHECKING"]
        only_types = {id(node) for block in types for node in ast.walk(block)}  # mypy finds what has moved there
        for node in ast.walk(tree):
            if id(node) in only_types:
                continue
            if isinstance(node, ast.ImportFrom) and (node.module or "").partition(".")[0] == "nicegui":
                names = OFFERED.get(node.module or "", set())
                outside += [(path.name, one.name) for one in node.names if names is not None and one.name not in names]
            elif isinstance(node, ast.Attribute) and ast.unparse(node) == "Client.instances":
                outside.append((path.name, "Client.instances"))
    assert outside == []


def test_only_the_folder_changes_how_the_page_starts() -> None:
    package = Path(server.__file__).parent
    words = ("gc.freeze", "setswitchinterval", "load_lazily(", 'leave_out("')
    users = {path for path in package.rglob("*.py") for word in words if word in path.read_text()}
    assert users == {FOLDER / "startup.py"}


def test_the_version_has_an_upper_bound_and_is_within_it() -> None:
    (wanted,) = (found for one in PROJECT["dependencies"] if (found := Requirement(one)).name == "nicegui")
    assert any(one.operator == "<" for one in wanted.specifier)
    assert wanted.specifier.contains(version("nicegui"))


@pytest.mark.parametrize(
    ("where", "names"),
    [
        (core.app, ("user_middleware", "add_exception_handler", "config", "storage")),
        (core.app.storage, ("max_tab_storage_age",)),
        (core.sio, ("handlers", "on", "disconnect", "eio")),
        (core.sio.eio, ("handlers", "on", "sockets", "ping_interval", "ping_timeout")),
        (Client, ("instances", "delete")),
        (client, ("templates",)),
    ],
    ids=lambda where: type(where).__name__,
)
def test_what_is_used_is_still_there(where: object, names: tuple[str, ...]) -> None:
    assert [name for name in names if not hasattr(where, name)] == []


def test_an_outbox_with_nothing_to_send_sleeps_until_it_is_told_and_ends(monkeypatch: pytest.MonkeyPatch) -> None:
    looks: list[float] = []
    wait = asyncio.Event.wait

    class OpenClient:
        id = "one"
        has_socket_connection = True

    async def counted(event: asyncio.Event) -> Literal[True]:
        looks.append(asyncio.get_running_loop().time())
        return await wait(event)

    async def main() -> None:
        let_outboxes_sleep()
        box, began = object.__new__(Outbox), asyncio.get_running_loop().time()
        vars(box).update(_client=OpenClient, updates={}, messages=[], _should_stop=False, _enqueue_event=None)
        running = asyncio.create_task(box.loop())
        await asyncio.sleep(100)
        assert looks == [began]
        box.stop()
        await asyncio.wait_for(running, 1)

    monkeypatch.setattr(asyncio.Event, "wait", counted)
    run_virtual(main())


class PageOfOurs:
    def __init__(self, page: Client) -> None:
        self.page = page
        page.on_delete(self.closed)

    def closed(self) -> None:
        pass


def test_what_was_deleted_of_a_page_and_what_it_told_are_freed_without_a_search(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(Client, "remove_elements", Client.remove_elements)
    monkeypatch.setattr(core.app, "_delete_handlers", [])
    free_deleted_elements()

    async def main() -> None:
        scope = {"type": "http", "method": "GET", "path": "/", "query_string": b"", "headers": [], "app": core.app}
        page = Client(page_builder("/"), request=Request(scope))
        told = weakref.ref(PageOfOurs(page))
        with page:
            box = ui.column()
            with box:
                line = ui.label("a line").classes("wide").style("color: red").props("dense")
        parts = [weakref.ref(part) for part in (line, line._props, line._classes, line._style)]
        del line
        box.clear()
        assert [part() for part in parts] == [None] * len(parts)
        kept = weakref.ref(box)
        del box
        assert None not in (kept(), told())
        page.delete()
        assert (kept(), told()) == (None, None)

    gc.disable()
    try:
        asyncio.run(main())
    finally:
        gc.enable()


def test_what_is_used_is_what_it_was() -> None:
    assert isinstance(core.sio, socketio.AsyncServer)
    assert isinstance(core.sio.eio, engineio.AsyncServer)
    assert isinstance(Client.instances, dict)
    assert {"connect", "disconnect", "message"} <= set(core.sio.eio.handlers)
    assert {"connect", "disconnect", "event", "javascript_response", "ack"} <= set(core.sio.handlers["/"])
    assert client.templates.env.loader is not None
    assert inspect.isclass(RedirectWithPrefixMiddleware)
