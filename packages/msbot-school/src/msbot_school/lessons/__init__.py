"""Lessons that check themselves: what is to be done at a robot, in steps, and whether it has been done."""
