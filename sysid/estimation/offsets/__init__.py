"""What a log's offsets are: removed, known or estimated."""
