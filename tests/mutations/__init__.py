"""Mutants of the numerical sources: whether the tests notice a wrong expression."""
