"""A measured mission compared with its simulated runs."""
