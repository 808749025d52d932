"""Threads, workers and clocks of a master's process."""
