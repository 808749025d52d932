"""The drivers, by what they have in common; the part types name them."""
