"""What a log can tell before any fit."""
