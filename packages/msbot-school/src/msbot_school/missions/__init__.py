"""Missions: faults that a class is to find and mend, and the marks for it."""
