"""Mutants of the numerical sources: whether the tests fail on a wrong expression."""
