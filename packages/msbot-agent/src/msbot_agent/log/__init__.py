"""How programs log: to a terminal, to the journal, as JSON, and bounded."""
