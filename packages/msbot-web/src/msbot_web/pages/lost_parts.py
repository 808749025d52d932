"""Parts that are lost: their number in the menu, and a word on every page when it happens."""

from __future__ import annotations

import asyncio
from collections import deque
from typing import TYPE_CHECKING

from nicegui import ui

from msbot.pnp import PartState
from msbot_web.glances import ShownRobot
from msbot_web.robot_view import OfRobot

if TYPE_CHECKING:
    from msbot_web.pages.page import Page


MOST_TOLD, TOLD_S = 4, 8.0
"""Parts of which a page says so at the same time, and for how long; the menu has the number of all."""


def _lost_slots(robot: ShownRobot) -> frozenset[str]:
    return frozenset(card.name for card in robot.slots if card.state == PartState.LOST.value)


lost_slots = OfRobot(_lost_slots)
"""The slots whose part is lost."""


def notify_lost(page: Page) -> None:
    """Say it on every page when a part is lost while the page is open, and no longer than it is."""
    known: frozenset[str] | None = None
    told = dict[str, ui.notification]()
    told_at = deque[float](maxlen=MOST_TOLD)

    def look() -> None:
        nonlocal known
        now = asyncio.get_running_loop().time()
        lost = lost_slots(page.service.glance())
        for name in sorted(set(told) - lost):
            if not (shown := told.pop(name)).is_deleted:  # its time is over, or somebody has closed it
                shown.dismiss()
        for name in sorted(lost - known) if known is not None else ():
            if len(told_at) == MOST_TOLD and now - told_at[0] < TOLD_S:
                break
            told_at.append(now)
            words = page.translate("The part in slot {name} is lost.", name=name)
            told[name] = ui.notification(words, type="negative", timeout=TOLD_S)
        known = lost

    page.every_look(look)
