"""Functional mock-up units (FMI 2.0 and 3.0) of scenes: description, packing, validation, thin adapters.

The adapters (``adapter``, ``fmi2``, ``fmi3``) travel inside the FMU and import nothing of the exporter or of the
solver at module level; the rest runs only where FMUs are built.
"""
