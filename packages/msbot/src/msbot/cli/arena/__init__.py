"""`msbot arena`: worlds for simulated robots."""
