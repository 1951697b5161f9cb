"""Many runs of one mission: what is drawn for each, all of them at once, and what they came to."""
