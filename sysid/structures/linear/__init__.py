"""ARX, ARMAX, OE, BJ and their kin: polynomials, predictors, starts, closed form."""
