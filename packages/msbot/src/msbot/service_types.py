"""How a service is written and carried: one type made of two messages, one topic made of two.

A port that serves takes a request and gives a reply, as in `"Angle -> Picture"`. In the data space a service on topic
`photo` is the request topic `photo_Request` and the reply topic `photo_Reply`, the names that DDS-XRCE gives.
"""

from __future__ import annotations

from typing import NamedTuple

ARROW = " -> "


class ServiceType(NamedTuple):
    """The names of the two messages of a service."""

    request: str
    reply: str

    def __str__(self) -> str:
        """As files, pages and configurations have it: `Angle -> Picture`."""
        return f"{self.request}{ARROW}{self.reply}"


def service_type(type_name: str) -> ServiceType | None:
    """The two messages of a service; None: the type is that of a topic."""
    request, arrow, reply = type_name.partition(ARROW)
    return ServiceType(request, reply) if arrow else None


def request_topic(topic: str) -> str:
    """Where the requests of a service are."""
    return f"{topic}_Request"


def reply_topic(topic: str) -> str:
    """Where the replies of a service are."""
    return f"{topic}_Reply"
