"""The flight recorder; reading and replaying recordings."""
