"""The commands about blueprints: write, check, compare, apply, export."""
