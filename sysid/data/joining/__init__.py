"""Several files of one experiment, joined by time."""
