"""Which topics carry requests and replies of services that can leave this process, by the names that ROS 2 gives."""

from __future__ import annotations


def is_request(topic: str) -> bool:
    """Whether a topic carries requests of this kind."""
    return topic.startswith("rq/") and topic.endswith("Request")


def is_reply(topic: str) -> bool:
    """Whether a topic carries replies of this kind."""
    return topic.startswith("rr/") and topic.endswith("Reply")


def crosses(topic: str) -> bool:
    """Whether it is either; other services, such as the robot's own inventory, stay in the process."""
    return is_request(topic) or is_reply(topic)
