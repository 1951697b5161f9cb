"""The laws of a mission as C: one step function each, and what they make together."""
