"""The database itself: tables, connections, schema versions, reading, and the one thread that writes."""
