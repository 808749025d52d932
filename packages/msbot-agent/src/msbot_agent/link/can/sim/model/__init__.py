"""The simulated bus, without I/O."""
