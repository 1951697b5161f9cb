"""Terramechanics: presets of soils, pressure, sinkage, resistances, drawbar pull, turning."""
