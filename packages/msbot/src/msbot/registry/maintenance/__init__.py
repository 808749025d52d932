"""Migrating, copying, checking and restoring a database."""
