"""What an extension brings as a page, and which of them there are: each has its address below `/x/`."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

from msbot.operations.rights import Right
from msbot_agent.startup.extensions import extensions
from msbot_xrce.lazy import dataclass

if TYPE_CHECKING:
    from msbot_web.pages.page import Page


@dataclass(frozen=True, slots=True)
class ExtensionPage:
    """A page that an extension brings."""

    title: str
    """Its heading, and its entry in the menu."""
    show: Callable[[Page], None]
    """Builds its content with NiceGUI; what it says goes through `page.say`, what it does through `page.act`."""
    icon: str = "extension"
    """Name of a Material icon."""
    right: Right = Right.SEE
    """Who sees it."""


def brought_pages() -> dict[str, ExtensionPage]:
    """The pages of extensions by their addresses."""
    return {f"/x/{name}": one for name, one in extensions().all("pages", ExtensionPage).items()}
