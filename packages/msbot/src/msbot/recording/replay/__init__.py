"""Recordings played again into a running robot: `msbot play`."""
