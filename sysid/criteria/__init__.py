"""How good a model is: fit, information criteria, residual tests."""
