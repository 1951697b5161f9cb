"""A look at a log before any model: impulse and frequency responses with bands, distortions."""
