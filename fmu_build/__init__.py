"""Functional mock-up units (FMI 2.0 and 3.0) of scenes: description, packing, validation, adapters, hosts.

=====================  ================================================================================================
build, compiled        the archive and what is in it; without Python: image, table of variables, library
description            modelDescription.xml, terminalsAndIcons.xml, the page of documentation
adapter, bridge        FMUs with Python: its side, and the library in C that starts it
checks, drive          validation; FMUs run step by step
reference, ssp         reference run in the archive; system structures of several FMUs
=====================  ================================================================================================

The functions of the FMI and their steps are in ``latin_fmu/cosim/runtime``, the variables in ``latin_fmu/cosim``.

``bridge`` is the library of an FMU, which calls the methods of ``adapter``, the only module that travels inside; it
imports nothing of the solver when it is loaded.
"""
