"""How much a test tries: little in every run, much with `MSBOT_THOROUGH=1` (a night)."""

import os

THOROUGH = bool(os.environ.get("MSBOT_THOROUGH"))


def tries(usually: int, thorough: int) -> int:
    """How often a test of random cases tries."""
    return thorough if THOROUGH else usually
