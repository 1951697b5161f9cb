"""The compound pendulum: from logs of a swing, or its period, to the inertia of a body."""
