"""What a running robot needs of the database: its memory, the right to run it, what it stores."""
