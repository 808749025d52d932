"""How often something may happen, and who may connect."""
