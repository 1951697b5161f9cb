"""One step, many ways to run it: plain numbers, arrays, compiled scans, recorded operations."""
