"""The database itself: tables, connecting, schema versions, reading, and the one thread that writes."""
