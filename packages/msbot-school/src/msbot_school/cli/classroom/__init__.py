"""Commands for all robots of a class."""
