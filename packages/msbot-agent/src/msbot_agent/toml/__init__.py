"""TOML files written by people; every mistake is reported with its line."""
