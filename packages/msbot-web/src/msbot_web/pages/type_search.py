"""Part types found by words, those of the library or those of the person's language."""

from __future__ import annotations

from msbot_web.api.models import TypeLine
from msbot_web.pages.layout import Page


def types_found(page: Page, wanted: str) -> list[TypeLine]:
    """The part types that fit, by their own words or by those of the person's language."""
    fitting, words = page.service.views.types(wanted), wanted.casefold().split()
    known = {line.number for line in fitting}
    return fitting + [
        line
        for line in page.service.views.types("")
        if line.number not in known
        and all(word in f"{page.say(line.name)} {page.say(line.description)}".casefold() for word in words)
    ]
