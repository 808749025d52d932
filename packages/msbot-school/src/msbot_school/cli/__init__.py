"""Commands: `msbot lesson`, `mission`, `fault`, `quiz`, `class`."""
