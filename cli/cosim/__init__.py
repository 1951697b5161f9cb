"""Commands that let a plant run in another machine's loop."""
