"""What every fit needs and no structure knows: problems, solvers, uncertainty, hold-outs."""
