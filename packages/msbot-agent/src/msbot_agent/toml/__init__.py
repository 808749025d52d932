"""TOML files written by people: every mistake is found and reported with its line."""
