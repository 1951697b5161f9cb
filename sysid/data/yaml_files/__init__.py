"""Hand-written YAML files: values with line numbers, and errors as sentences."""
