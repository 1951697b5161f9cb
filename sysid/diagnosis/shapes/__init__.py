"""What explains errors without physics: curves, steps and drifts, waves, linear motion."""
