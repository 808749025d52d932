"""A person wants a node to take new software: the service `update` of its part.

First the reply goes out; then the part leaves its robot with that reason, which makes the node safe; then it is told.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from typing import Final

from msbot.part import Message
from msbot.part.messages.standard import Text
from msbot_bridges.bridge import DeviceService
from msbot_bridges.canbus.image_folder import ImageFolder
from msbot_xrce.errors import CallError, ConfigError

REPLY_S: Final = 0.3
"""So long after the request a node is still in its robot."""
UPDATE: Final = DeviceService("update", Text, Text)


class SoftwareWish:
    """That of one node.

    Args:
        where: the node, for people: `node 42`.
        images: from which it can get new software.
        news: called when it leaves its robot, or may come back.
    """

    def __init__(self, where: str, images: ImageFolder, news: Callable[[], None]) -> None:
        self.state = ""
        """That it takes new software, as a sentence: it is no part of its robot meanwhile."""
        self._where, self._images, self._news = where, images, news
        self._image = ""

    def serve(self, request: Message) -> Message:
        """Somebody wants it to take an image.

        Raises:
            CallError: there is no such image, or it takes one already.
        """
        assert isinstance(request, Text)
        try:
            self._images.check(request.text)
        except ConfigError as error:
            raise CallError(str(error)) from error
        if self._image:
            raise CallError(f"{self._where} takes {self._image} already")
        self._image = request.text
        words = f"{self._where} takes new software ({request.text})"
        asyncio.get_running_loop().call_later(REPLY_S, self._leave, words)
        return Text(text=f"{words}; the robot's log says how it ends")

    def _leave(self, words: str) -> None:
        if self._image:
            self.state = words
            self._news()

    def take(self) -> str:
        """It has left its robot: the image that it is to be told now; empty: none."""
        image, self._image = self._image, ""
        return image

    def end(self) -> None:
        """It has not taken it, and goes on as it was."""
        self.state = ""
        self._news()
