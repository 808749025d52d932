"""Lessons that check themselves at a robot."""
