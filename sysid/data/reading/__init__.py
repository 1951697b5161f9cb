"""From the text of a log to columns, units and times."""
