"""The plant as C99."""
