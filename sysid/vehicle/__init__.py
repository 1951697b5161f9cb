"""Pure physics of the tracked vehicle."""
