"""The method itself, each formula once: compiled functions (``compiled``) on the memory of one run (``records``).

Read ``iteration`` first: one iteration is ``linear_stage``, ``local_stage``, ``indicator``; then ``acceleration``.

=====================================  ================================================================================
iteration                              the loop over one window, and when it stops
linear_stage, substructure             W of the substructures for given q, Eqs. (8)-(14); one class over one instant
local_stage                            tractions and velocities point by point, Eqs. (15)-(17); laws are in ``laws``
indicator                              eta, Eq. (24), force residual, work of the error
acceleration                           next q: relaxation and Anderson acceleration
instants, prediction                   from one instant to the next; its first guess
newton, active_points, envelope        Newton steps where the iteration is slow: unknowns and matrix, LU factors
krylov, tied, iteration_step           the same by products: on large interfaces, preconditioner, without inertia
energy, energy_parts                   energies of the substructures
maxwell, face                          Maxwell branches in the march; interface dofs without mass
matrices, products, patched, splits    products with matrices of a class: sparse, dense, in patches, by threads
half_solves, sparse_response           substitution through the factor of a class; sparse tables in its place
records, entries, callouts             memory of a run; how Python calls the kernels, and they call Python
sums, tasks, team                      sums over the assembly, also of several processes; work shared by threads
communication, inputs, outputs         a step of co-simulation: what drives it, what is read of it
derivatives, tangent_march             derivatives of outputs by inputs, of a run by parameters
=====================================  ================================================================================
"""
