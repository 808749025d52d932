"""Who may see and do what: accounts, roles, sign-in, and the gate in front of every request."""
