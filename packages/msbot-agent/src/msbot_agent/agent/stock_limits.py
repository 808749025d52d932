"""What a stock client cannot take, whatever the agent does."""

from __future__ import annotations

import logging
from collections.abc import Mapping

from msbot_agent.agent.gate import ClientInfo
from msbot_xrce import GIVEN_UP
from msbot_xrce.common.tally import Tally

logger = logging.getLogger(__name__)

LARGEST_TO_STOCK = 0xFFFF - 4
"""Octets of the largest sample for a stock client: with the ids in front, its length must fit 16 bits."""
TOO_LARGE_FOR_STOCK = "sample too large for a stock client"


def drop_too_large(info: ClientInfo, object_id: int, size: int, dropped: Tally) -> None:
    """Count a sample that is not sent, and tell of the first: it would arrive cut, and spoil what follows it."""
    if TOO_LARGE_FOR_STOCK not in dropped:
        logger.warning(
            "client %08X, object %04X: a sample of %d octets is not sent, as none above %d is: stock clients count in"
            " 16 bits",
            info.key,
            object_id,
            size,
            LARGEST_TO_STOCK,
        )
    dropped.count(TOO_LARGE_FOR_STOCK)


def tell_of_lost(info: ClientInfo, stream_id: int, count: int, dropped: Mapping[str, int]) -> None:
    """Tell of messages that a client has lost; of the first ones aloud, since a network that reorders makes many."""
    level = logging.WARNING if dropped[GIVEN_UP] == count else logging.DEBUG
    logger.log(
        level,
        "client %08X on %s: %d message(s) of stream 0x%02X are lost: its network let acknowledgements overtake each"
        " other, and a stock client then forgets what it has sent",
        info.key,
        info.link,
        count,
        stream_id,
    )
