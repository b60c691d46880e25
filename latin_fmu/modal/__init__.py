"""Analyses in the frequency domain: modes, frequency responses, and the backbone of a joint."""
