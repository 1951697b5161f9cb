"""The search for effects: candidates, evidence, forward selection, intervals."""
