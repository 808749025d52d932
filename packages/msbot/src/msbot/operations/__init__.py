"""What a person can do to a robot: the table of operations, and their execution.

Page, API, commands and requests of other processes all follow `table.OPERATIONS`. This module imports nothing, so
that a command can read the table without loading the database: import from the modules themselves.
"""
