"""Commands about the vehicle itself."""
