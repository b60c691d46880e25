"""Model Exchange: a reduced model of a scene as ordinary differential equations, to cross-check the LATIN solution.

A few modes and static shapes per body, faces cut into patches, contact and friction regularised. Bodies, patches and
contact laws are those of the reduced model; only meshes, matrices and the reader of scenes are shared with the solver,
so that the two are independent. Impulse of the contact against LATIN, per cent, by modes per body:

====================== ===== ===== ===== =====
model                    4     8    12    24
====================== ===== ===== ===== =====
impact_bar              -0.2   0.4   0.6   0.7
beam_in_traction         6.2   3.0   1.7   0.8
two_specimen_crushing    0.7   0.7   0.6   0.7
bouncing_bar            -2.1  -1.0  -0.2  -0.2
====================== ===== ===== ===== =====

It does not resolve wave fronts, pressures at points, nor motion after many bounces. A static check refuses patches that
are too coarse for the bending of a body (``punched_plates``: a punch on the middle of a plate).

============  =====================================================================================
reduce        scene -> ``ReducedSystem``: bodies, patches, bonds, Ritz coordinates, static check of the patches; names
              and units of the variables, their references
equations     ``ReducedSystem`` and ``Names``, as bytes and back; laws over time, regularised contact and friction,
              event indicators, right-hand side, outputs
fmi_instance  variables by reference, time, states and events for an adapter; no exception leaves it
============  =====================================================================================
"""
