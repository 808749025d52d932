"""What every test shares: hypothesis without wall-clock deadlines (the machine may be busy)."""

from hypothesis import HealthCheck, settings

settings.register_profile("msbot", deadline=None, suppress_health_check=[HealthCheck.too_slow])
settings.load_profile("msbot")
