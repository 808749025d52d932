"""Loads what extensions bring for the page, as it is loaded when it is used: for `msbot extensions`."""

from __future__ import annotations

from msbot_agent.startup.extensions import extensions


def load_for_pages() -> None:
    """Pages and calls of the API."""
    brought = extensions()
    brought.all("routes", object)
    if brought.names("pages"):
        from msbot_web.pages.extension_page import brought_pages

        brought_pages()
