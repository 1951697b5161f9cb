"""Assessment of a fitted model: figures, step response, findings, advice."""
