"""Numerical fitting, independent of structures: problems, solvers, uncertainty, hold-outs."""
