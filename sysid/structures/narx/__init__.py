"""NARX with a wavelet network: the structure and its fit."""
