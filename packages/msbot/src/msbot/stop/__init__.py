"""How `msbot stop` reaches every master of a user: sockets, names, groups."""
