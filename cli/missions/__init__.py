"""Commands around missions."""
