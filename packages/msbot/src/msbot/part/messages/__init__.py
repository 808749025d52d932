"""Messages: how a class becomes CDR, and the standard messages."""
