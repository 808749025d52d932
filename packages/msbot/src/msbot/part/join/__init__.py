"""How a part joins its robot: the two steps, the beats, keys and UIDs."""
