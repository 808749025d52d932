"""The commands about blueprints: write, check, compare, put into force, export."""
