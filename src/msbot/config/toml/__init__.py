"""TOML files of people: every mistake is found and told with its line."""
