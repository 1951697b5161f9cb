"""Continuous time: process models and transfer functions in s, with dead time."""
