"""The plant package: a model written so that every runtime reproduces it."""
