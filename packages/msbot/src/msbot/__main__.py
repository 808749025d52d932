"""`python -m msbot`: the command."""

from msbot_command import main

if __name__ == "__main__":
    main()
