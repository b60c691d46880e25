"""Accuracy and its cost: quantities of runs, error estimates, adaptive resolution, work-precision studies."""
