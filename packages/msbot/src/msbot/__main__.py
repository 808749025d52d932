"""`python -m msbot`: the command."""

from msbot_agent.cli import main

if __name__ == "__main__":
    main()
