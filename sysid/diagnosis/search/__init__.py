"""Which effects would explain what a model misses: candidates, search, naming, intervals."""
