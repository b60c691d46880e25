"""Compiled march: whole instants (all substructures, all LATIN iterations) without the interpreter in between.

The kernels repeat, operation for operation, what ``propagator.direct`` and ``latin.solver`` say in NumPy; those
serve wherever something is asked for that the kernels do not do, and tests compare the two. Modules but
``least_squares`` need numba: they are imported where compilation is on.
"""
