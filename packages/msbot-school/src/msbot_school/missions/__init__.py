"""Missions: faults that a class finds and repairs, and marks."""
