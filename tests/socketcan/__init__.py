"""Tests on a CAN bus of a real kernel, inside virtual machines (CONTRIBUTING.md)."""
