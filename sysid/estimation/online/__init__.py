"""Online (recursive) estimation of a log row by row."""
