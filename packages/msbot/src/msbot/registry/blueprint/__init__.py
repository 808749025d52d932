"""Blueprints in the database: stored, read back, and kept as snapshots for undo."""
