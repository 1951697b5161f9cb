"""Diagnosis: where a model disagrees with data, which effect is missing, and the validation."""
