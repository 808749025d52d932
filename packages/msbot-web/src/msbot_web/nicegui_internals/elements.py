"""What elements of NiceGUI have and do not offer."""

from nicegui import ui
from nicegui.elements.mixins.disableable_element import DisableableElement

__all__ = ["DisableableElement", "forget_content"]


def forget_content(element: ui.html) -> bool:
    """Keep no copy of what a connected browser has been given, and changes by itself from now on.

    Returns:
        False if the browser has not got it yet.
    """
    client = element.client
    if not client.has_socket_connection or element.id in client.outbox.updates:
        return False
    vars(element)["___content"] = ""  # where NiceGUI keeps it; `set_content` would send it
    dict.__setitem__(element._props, element.CONTENT_PROP, "")  # noqa: SLF001
    return True
