"""Curves: the numbers of a robot over time, read from recordings or taken while it runs, and drawn."""
