"""A small broker for simulated devices on this computer, where no other is installed."""
