"""A grey box from a file: states, parameters and equations that a person wrote in YAML."""
