"""What NARX and NARMAX share: lagged signals, terms, FROLS, chunks of a run."""
