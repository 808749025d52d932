"""What every test shares: hypothesis without wall-clock deadlines (the machine may be busy), and its own STOP."""

import os

from hypothesis import HealthCheck, settings

from msbot.runtime.stop_datagram import GROUP_VARIABLE

# Tests run beside each other: a STOP of one must not reach the robots of another.
os.environ[GROUP_VARIABLE] = f"test{os.getpid()}"

settings.register_profile("msbot", deadline=None, suppress_health_check=[HealthCheck.too_slow])
settings.load_profile("msbot")
