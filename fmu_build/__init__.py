"""Functional mock-up units (FMI 2.0 and 3.0) of scenes: description, packing, validation, adapters, hosts.

``bridge`` is the library of an FMU, which calls the methods of ``adapter``, the only module that travels inside; it
imports nothing of the solver when it is loaded.
"""
