"""Model Exchange: a reduced model of a scene as ordinary differential equations, to cross-check the LATIN solution.

A few modes and static answers per body, faces cut into patches, contact and friction regularised. Bodies, patches and
laws of contact are the reduced model's own; only meshes, matrices and the reading of the scene are shared with the
solver, so that agreement of the two says something.

===============  ======================================================================================
patches          faces cut into patches
bodies           bonded substructures as one body
reduced_body     a body in its Ritz coordinates
contacts, bonds  interfaces seen from the bodies
reduce           scene -> ``ReducedSystem``
system           the numbers of a reduced model, as bytes and back
amplitudes       loads and ground motions between the jumps of their laws
contact_law      regularised contact and friction, event indicators
equations        right-hand side
readings         outputs
variables        names, units, value references; ``names`` reads them inside an FMU
board, guard     inputs, parameters, last outputs; no exception leaves
exchange_model   all of it behind numbered variables, for an adapter
===============  ======================================================================================
"""
