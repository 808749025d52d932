"""The flight recorder and its recordings: `msbot rec`, `msbot log`."""
