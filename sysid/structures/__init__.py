"""Model structures, their algebra, and the Model of a fit."""
