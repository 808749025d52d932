"""All robots of a class: discovery, STOP for all, one blueprint for many."""
