"""Measures of a model's quality: fit, information criteria, residual tests."""
