"""`python -m msbot` is the `msbot` command."""

from msbot.cli import main

main()
