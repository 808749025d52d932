"""`msbot library`: the part types that robots are made of."""
