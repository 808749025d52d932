"""What all clients of one agent share."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import field
from itertools import count
from typing import TYPE_CHECKING

from msbot_agent.agent.agent_settings import AgentSettings
from msbot_agent.agent.gate import Gate
from msbot_agent.agent.object_creation import Creator
from msbot_agent.agent.object_tree import ObjectBudget
from msbot_agent.agent.reply_routing import ReplyExchange
from msbot_agent.agent.statistics import TopicTable, Transit
from msbot_agent.space import Space
from msbot_xrce import References
from msbot_xrce.lazy import dataclass

if TYPE_CHECKING:
    from msbot_agent.agent.proxy import Proxy


@dataclass(slots=True)
class SharedAgentState:
    """What all clients of one agent share."""

    space: Space
    gate: Gate
    settings: AgentSettings
    clock: Callable[[], float]
    agent_id: bytes
    """8 octets, drawn afresh for every agent: the first half of all its GUIDs."""
    mark: Callable[[Proxy], None]
    """Have the client's packets sent at the end of this turn of the loop."""
    rest: Callable[[Proxy], None]
    """Do not wake the client before it is marked again: nothing of it waits for a time."""
    replies: ReplyExchange
    transit: Transit
    references: References | None = None
    creator: Creator | None = None
    topics: TopicTable = field(default_factory=lambda: TopicTable(4096))
    budget: ObjectBudget = field(default_factory=lambda: ObjectBudget(200_000))
    incarnations: Iterator[int] = field(default_factory=lambda: count(1))
