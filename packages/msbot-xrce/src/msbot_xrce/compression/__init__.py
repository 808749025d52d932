"""Header compression for slow buses: makes messages shorter, and restores them exactly."""
