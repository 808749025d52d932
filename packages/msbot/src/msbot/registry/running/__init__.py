"""What a running robot needs from the database: its memory, the right to run it, what it stores."""
