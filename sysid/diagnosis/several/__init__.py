"""Several logs of one machine: what is the same in all of them, and what differs."""
