"""What a model lacks: where it disagrees with data, which effect is missing, and the proof."""
