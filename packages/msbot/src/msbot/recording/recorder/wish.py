"""What a person wants to be recorded: the value of `--rec`."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Final

from msbot_xrce.common.lazy_dataclass import dataclass
from msbot_xrce.errors import ConfigError

RING_S: Final = 600.0
RING_OCTETS: Final = 256 << 20
LEAST_S: Final = 10.0
LEAST_OCTETS: Final = 1 << 20
MOST_S: Final = 30 * 24 * 3600.0
MOST_OCTETS: Final = 1 << 40
SUFFIX: Final = ".mcap"
_SECONDS: Final = {"s": 1, "min": 60, "h": 3600}
_OCTETS: Final = {"MB": 1 << 20, "GB": 1 << 30}
_AMOUNT: Final = re.compile(r"(\d+(?:\.\d+)?)\s*(s|min|h|MB|GB)", re.IGNORECASE)


@dataclass(frozen=True, slots=True)
class RecordingWish:
    """How much is recorded, and where."""

    on: bool = True
    seconds: float = RING_S
    octets: int = RING_OCTETS
    """The ring keeps at most so much."""
    file: Path | None = None
    """A file that gets everything from the start as well."""


def read_wish(text: str) -> RecordingWish:
    """The wish in the text.

    Raises:
        ConfigError: it is none; the text says what would be.
    """
    if text.strip().lower() == "off":
        return RecordingWish(on=False)
    if text.lower().endswith(SUFFIX):
        return RecordingWish(file=Path(text))
    seconds: float | None = None
    octets: int | None = None
    for word in text.split(","):
        match = _AMOUNT.fullmatch(word.strip())
        unit = "" if match is None else match[2].upper() if match[2].upper() in _OCTETS else match[2].lower()
        if match is None or (unit in _OCTETS and octets is not None) or (unit in _SECONDS and seconds is not None):
            raise ConfigError(
                f'{text!r}: say how much to keep ("10min", "2h", "500MB", "30min,500MB"), '
                f'a file ("lesson{SUFFIX}"), or "off"'
            )
        if unit in _OCTETS:
            octets = round(float(match[1]) * _OCTETS[unit])
        else:
            seconds = float(match[1]) * _SECONDS[unit]
    wish = RecordingWish(
        seconds=RING_S if seconds is None else seconds, octets=RING_OCTETS if octets is None else octets
    )
    if not LEAST_S <= wish.seconds <= MOST_S or not LEAST_OCTETS <= wish.octets <= MOST_OCTETS:
        raise ConfigError(f"{text!r}: at least 10s and 1MB, at most 720h and 1024GB")
    return wish
