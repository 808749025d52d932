"""What people change, one transaction each: the list of edits, undo, and each kind of change."""
