"""Header compression for slow buses: shorter messages and back, exactly."""
