"""What a person can do to a robot: adopt, swap, release, block, set, bind, undo, stop; for page and shell alike."""

from msbot.operations.live import Operations
from msbot.operations.outcome import Outcome
from msbot.operations.requests import perform
from msbot.operations.stopping import StopReport
from msbot.operations.stored import StoredOperations

__all__ = ["Operations", "Outcome", "StopReport", "StoredOperations", "perform"]
