"""What a fitted model is worth and what it does: figures, step answer, findings, advice."""
