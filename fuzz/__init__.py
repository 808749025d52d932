"""Fuzzing: random and mutated input for everything that takes octets or text from others.

`python -m fuzz` runs all targets; fuzz/README.md says how. A *case* is a list of steps (a packet
comes, time passes, a link is full ...), so that it can be stored, made smaller and run again. Nothing in a case depends
on the clock of the machine: everything asynchronous runs in virtual time.
"""
