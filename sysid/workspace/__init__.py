"""What holds models, comparisons and plants between commands."""
