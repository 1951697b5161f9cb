"""The DC motor and its ladder of friction models."""
