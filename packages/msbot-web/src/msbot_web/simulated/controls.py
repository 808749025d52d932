"""What the page needs from simulated parts that run in this process: plug, unplug, operate, look."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Protocol

from msbot_web.models.robot_models import Scalar, SimulatedPartControl


class SimulatedControls(Protocol):
    """Simulated parts by the name of the slot they were made for."""

    def slots(self) -> tuple[str, ...]:
        """The names of the simulated parts."""

    def is_plugged(self, slot: str) -> bool:
        """Whether that part is on the wire."""

    def uid(self, slot: str) -> bytes:
        """The UID of that part, plugged in or not; empty: it has none."""

    def plug(self, slot: str) -> None:
        """Plug a part in; nothing happens if it is."""

    def unplug(self, slot: str) -> None:
        """Pull a part out, without a goodbye."""

    def controls(self, slot: str) -> tuple[SimulatedPartControl, ...]:
        """What a person can do to that part."""

    def operate(self, slot: str, control: str, value: Scalar) -> None:
        """Do it.

        Raises:
            ConfigError: there is no such control, or it does not take that value.
        """

    def rest_value(self, slot: str, control: str) -> Scalar | None:
        """The value that a control goes back to when it is released; None: it stays, or is not there."""

    def readings(self, slot: str) -> Mapping[str, Scalar]:
        """What one would see of the part."""

    def reading_words(self, slot: str) -> Mapping[str, tuple[str, str]]:
        """What its readings mean, in words, and their units, by name; those without words are left out."""


class NoSimulatedControls:
    """A robot without simulated parts."""

    def slots(self) -> tuple[str, ...]:
        """None."""
        return ()

    def is_plugged(self, slot: str) -> bool:  # noqa: ARG002 - the protocol's signature
        """Never."""
        return False

    def uid(self, slot: str) -> bytes:  # noqa: ARG002
        """None."""
        return b""

    def plug(self, slot: str) -> None:
        """There is nothing to plug in."""

    def unplug(self, slot: str) -> None:
        """There is nothing to pull out."""

    def controls(self, slot: str) -> tuple[SimulatedPartControl, ...]:  # noqa: ARG002
        """None."""
        return ()

    def operate(self, slot: str, control: str, value: Scalar) -> None:
        """There is nothing to operate."""

    def rest_value(self, slot: str, control: str) -> Scalar | None:  # noqa: ARG002
        """None."""
        return None

    def readings(self, slot: str) -> Mapping[str, Scalar]:  # noqa: ARG002
        """None."""
        return {}

    def reading_words(self, slot: str) -> Mapping[str, tuple[str, str]]:  # noqa: ARG002
        """None."""
        return {}
