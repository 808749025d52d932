"""What every test shares: hypothesis without wall-clock deadlines (the machine may be busy), its own STOP, and that no
event loop waits for a database."""

import os

from hypothesis import HealthCheck, settings

from msbot.runtime.stop_datagram import GROUP_VARIABLE
from tests.loop_guard import guard

# The robots that tests start record nothing, unless a test wants it: the recordings belong to the user's own robots.
os.environ["MSBOT_REC"] = "off"

# Tests run beside each other: a STOP of one must not reach the robots of another.
os.environ[GROUP_VARIABLE] = f"test{os.getpid()}"

settings.register_profile("msbot", deadline=None, suppress_health_check=[HealthCheck.too_slow])
settings.load_profile("msbot")

guard()
