"""`python -m msbot` is the `msbot` command."""

from msbot_agent.cli import main

main()
