"""A DC motor on the bench: its experiments, its constants, and the model they make."""
