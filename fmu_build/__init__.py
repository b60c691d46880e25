"""Functional mock-up units (FMI 2.0 and 3.0) of scenes: description, packing, validation, adapters, hosts.

``adapter`` is the only module that travels inside an FMU; it imports nothing of the exporter or the solver when it is
loaded.
"""
