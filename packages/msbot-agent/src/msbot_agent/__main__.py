"""`python -m msbot` is the `msbot` command."""

from msbot_command import main

main()
