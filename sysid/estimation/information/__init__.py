"""What an experiment says of parameters before they are estimated from it."""
