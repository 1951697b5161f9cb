"""How a model is found: the parameter search, the choice of terms and units, and the outcome."""
