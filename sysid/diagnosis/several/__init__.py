"""Several logs of one machine: which estimates agree, and which differ."""
