"""A mission that was driven, against the runs that were predicted for it."""
