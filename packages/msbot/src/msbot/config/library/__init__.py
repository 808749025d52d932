"""The part library: part types, message types and simulators, read from TOML files."""
