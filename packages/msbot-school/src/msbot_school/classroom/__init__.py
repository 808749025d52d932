"""All robots of a class, wherever their masters run: who they are, STOP for all, one blueprint for many."""
