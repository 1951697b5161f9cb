"""Physical models: the base class, its fit, and the models that come with the package."""
