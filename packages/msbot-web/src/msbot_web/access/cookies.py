"""The names of a robot's cookies. Cookies know no ports, so each robot on a computer has names of its own."""

from __future__ import annotations

from msbot_xrce.common.lazy_dataclass import dataclass


@dataclass(frozen=True, slots=True)
class CookieNames:
    """What the cookies of one robot are called."""

    session: str = "msbot_session"
    """Holds the session's word."""
    device: str = "msbot_device"
    """The word of a browser that a person is known in."""


def cookie_names(mark: str) -> CookieNames:
    """The names for the robot with that mark: letters and digits."""
    return CookieNames(f"msbot_session_{mark}", f"msbot_device_{mark}")
