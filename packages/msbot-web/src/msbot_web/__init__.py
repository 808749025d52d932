"""The web pages of a robot and their JSON API (the thesis' Manual Configuration Management System, 5.4.2).

Heavy to import (NiceGUI), so only commands that serve a page import it, and only when they run.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from msbot_web.nicegui_internals.startup import load_less
from msbot_xrce.lazy import lazy_face

if TYPE_CHECKING:
    from msbot_web.pages.extension_page import ExtensionPage
    from msbot_web.pages.page import Page
    from msbot_web.service import Service

load_less()

_NAMES = {
    "msbot_web.pages.extension_page": ("ExtensionPage",),
    "msbot_web.pages.layout": ("Page",),
    "msbot_web.service": ("Service",),
}

__getattr__ = lazy_face(__name__, _NAMES)

__all__ = ["ExtensionPage", "Page", "Service"]
