"""Whether every runtime of a plant package gives what Python gave."""
