"""Parametric studies: one scene solved for all combinations of the values of some of its keys."""
