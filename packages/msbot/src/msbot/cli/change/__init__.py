"""The commands that change a robot: one for each operation."""
