"""Many runs of one mission: samples, compiled runs, results."""
