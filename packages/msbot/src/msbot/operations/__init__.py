"""What a person can do to a robot: one table of operations, and what carries them out.

Page, API, commands and requests of other processes all follow `table.OPERATIONS`. This module imports nothing, so
that a command can read the table without loading the database: import from the modules themselves.
"""
