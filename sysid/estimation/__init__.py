"""Estimation for all structures: fits, offsets of a log, selection, assessment."""
