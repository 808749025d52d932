"""Elements that were deleted are freed at once.

Each element of NiceGUI has three lists of handlers that refer to their own holder, and each page is told by handlers of
its own that it was closed. Only a search of Python's collector would free what refers to itself; it comes seldom in a
robot's process, and until then some hundreds of elements of each page would wait for it.
"""

from __future__ import annotations

from collections.abc import Iterable

from nicegui import Client, app
from nicegui.element import Element


def free_deleted_elements() -> None:
    """From now on, in this process."""
    remove = Client.remove_elements

    def remove_elements(self: Client, elements: Iterable[Element]) -> None:
        removed = list(elements)
        remove(self, removed)
        for element in removed:
            for described in (element._props, element._classes, element._style):  # noqa: SLF001 - no other way
                described._change_handlers.clear()  # noqa: SLF001

    Client.remove_elements = remove_elements  # type: ignore[method-assign]
    app.on_delete(_forget_handlers)


def _forget_handlers(client: Client) -> None:
    """NiceGUI has called them all when it calls this."""
    for handlers in (client.connect_handlers, client.disconnect_handlers, client.delete_handlers):
        handlers.clear()
