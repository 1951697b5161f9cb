"""Exporters: a fitted model as a plant package, and the forms in which it runs elsewhere."""
