"""Read a log: columns, units and times."""
