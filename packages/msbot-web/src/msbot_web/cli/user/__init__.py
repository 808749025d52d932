"""`msbot user`: the people who may sign in on the page."""
