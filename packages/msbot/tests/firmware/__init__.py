"""Tests of the C firmware in `firmware/c`."""
