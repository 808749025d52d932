"""What every distribution above needs as well: quick dataclasses, counters, counted nouns."""
