"""Solids as foreign programs write them; each module runs in an environment of its own."""
