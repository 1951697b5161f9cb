"""Static functions of one signal, as the block-oriented structures hold them."""
