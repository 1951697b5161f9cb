"""Selection of orders, delays and structures, and comparison of models."""
