"""What nodes of DroneCAN and Cyphal have in common as parts: told so, they restart, and take new software."""

from __future__ import annotations

from abc import abstractmethod
from typing import Final

from msbot.part import Message
from msbot.part.messages.standard import Text, Trigger
from msbot_bridges.bridge import DeviceIdentity, DeviceService, ForeignDevice
from msbot_bridges.canbus.image_folder import ImageFolder
from msbot_bridges.canbus.software_wish import UPDATE, SoftwareWish

RESTART: Final = "restart"
"""A service."""


class UpdatableNode(ForeignDevice):
    """One node.

    Args:
        identity: from what it says of itself.
        node_id: where it is.
        images: from which it can get new software; None: from none.
        remark: how it got the software that it has.
    """

    def __init__(self, identity: DeviceIdentity, node_id: int, images: ImageFolder | None, remark: str) -> None:
        self.identity, self.node_id = identity, node_id
        self.services = (DeviceService(RESTART, Trigger, Text),)
        self._remark = remark
        self._wish: SoftwareWish | None = None
        if images is not None:
            self._wish = SoftwareWish(f"node {node_id}", images, self.changed)
            self.services += (UPDATE,)

    # What a world does

    @abstractmethod
    def changed(self) -> None:
        """Its fault may be another one now."""

    @abstractmethod
    def tell_restart(self) -> None:
        """Have it restart."""

    @abstractmethod
    def tell_update(self, image: str) -> None:
        """It has left its robot: give it new software, by the name of its image."""

    # For the kinds

    def take_update(self) -> None:
        """It has left its robot: tell it to take the image that somebody wants it to have, if there is one."""
        if self._wish is not None and (image := self._wish.take()):
            self.tell_update(image)

    @property
    def update_words(self) -> str:
        """That it takes new software, as a sentence; empty: nobody wants it to."""
        return "" if self._wish is None else self._wish.state

    def not_updated(self, why: str) -> None:
        """It has not taken new software, and goes on as it was."""
        self._remark = why
        if self._wish is not None:
            self._wish.end()

    # The contract

    def serve(self, name: str, request: Message) -> Message:
        """See `ForeignDevice`."""
        if name == UPDATE.name:
            assert self._wish is not None
            return self._wish.serve(request)
        self.tell_restart()
        return Text(text=f"node {self.node_id} was told to restart")

    @property
    def remark(self) -> str:
        """See `ForeignDevice`."""
        return self._remark
