"""Model Exchange: a reduced model of a scene as ordinary differential equations, to cross-check the LATIN solution.

A few modes and static answers per body, faces cut into patches, contact and friction regularised. Bodies, patches and
laws of contact are the reduced model's own; only meshes, matrices and the reading of the scene are shared with the
solver, so that agreement of the two says something. Impulse of the contact against LATIN, per cent, by modes per body:

====================== ===== ===== ===== =====
model                    4     8    12    24
====================== ===== ===== ===== =====
impact_bar              -0.2   0.4   0.6   0.7
beam_in_traction         6.2   3.0   1.7   0.8
two_specimen_crushing    0.7   0.7   0.6   0.7
bouncing_bar            -2.1  -1.0  -0.2  -0.2
====================== ===== ===== ===== =====

What it does not give: fronts of waves, pressures at points, what follows many bounces. Patches that are too coarse for
how a body bends (``punched_plates``: a punch on the middle of a plate) are found out by a static check and refused.

===============  ======================================================================================
patches          faces cut into patches
bodies           bonded substructures as one body
reduced_body     a body in its Ritz coordinates
contacts, bonds  interfaces seen from the bodies
reduce           scene -> ``ReducedSystem``
static_check     whether the patches are fine enough
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
