"""Physical models: the base class, its fit, and bundled models."""
