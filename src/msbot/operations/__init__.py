"""What a person can do to a robot: adopt, swap, release, block, set, bind, undo, stop; for page and shell alike."""

from msbot.operations.live import Operations
from msbot.operations.outcome import Outcome
from msbot.operations.stopping import StopReport

__all__ = ["Operations", "Outcome", "StopReport"]
