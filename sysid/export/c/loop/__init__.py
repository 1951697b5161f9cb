"""The laws of a mission as C: one step function each, and the controller made of them."""
