"""Quick start of programs; extensions by other packages."""
