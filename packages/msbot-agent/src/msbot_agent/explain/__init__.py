"""Captures and explanations for `msbot explain` and `msbot quiz`."""
