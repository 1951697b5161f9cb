"""The ledger of judgement: what may speak against an accepted effect, a file each."""
