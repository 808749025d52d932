"""The look at this computer: every function returns facts, or raises CannotSee."""
