"""The commands with a page: the demo, and who may sign in."""
