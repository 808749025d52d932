"""What the gate of an agent that a master feeds needs of the agent around it."""

from __future__ import annotations

from typing import Protocol

from msbot.part.join import plug
from msbot.pnp.fed_agents.messages import FromAgent
from msbot.pnp.profile import Profile


class AroundAgent(Protocol):
    """What the gate does to the agent around it."""

    def send(self, message: FromAgent) -> None:
        """Say it to the master; what cannot be said now is lost."""

    def rights_changed(self, client_key: int) -> None:
        """The verdict on that client has changed."""

    def topics_changed(self) -> None:
        """Other topics than before are used by clients that are in."""

    def answer(self, in_compat: bool, identity: bytes, body: bytes) -> None:
        """The inventory says something to a part."""

    def order(self, kind: plug.NoticeKind, number: int) -> None:
        """STOP or GO to all."""

    def welcome(self, profile: Profile) -> None:
        """The master says which robot this is."""

    def gone(self, client_key: int) -> None:
        """A client's session has ended."""

    def close(self, client_key: int, reason: str) -> None:
        """End a client's session."""

    def heard_at(self, client_key: int) -> float | None:
        """When a client was last heard."""

    def probe(self, client_key: int) -> None:
        """Ask a client for a sign of life."""

    def say(self, words: str) -> None:
        """Tell people."""
