"""The commands of teaching: `msbot lesson`, `mission`, `fault`, `quiz`, `class`."""
