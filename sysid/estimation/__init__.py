"""What serves all structures: the one entry to fits, choosing, levels of a log, judging a model."""
