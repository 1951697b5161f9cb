"""Polynomial NARMAX: the structure, its search for terms and its fit."""
