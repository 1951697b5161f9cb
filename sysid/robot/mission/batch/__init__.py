"""Many runs of one mission: what differs between them, one compiled loop, and who runs them."""
