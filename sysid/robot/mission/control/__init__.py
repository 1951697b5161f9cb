"""Controllers: from references and estimate to commands, one law a file."""
