"""Linear blocks between static ones: Hammerstein-Wiener and Wiener-Hammerstein, and their fits."""
