"""Extensions of sysid, one a file; pyproject.toml names them."""
