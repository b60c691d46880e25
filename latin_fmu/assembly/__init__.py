"""From the scene to the operators of the solver.

=========================  ============================================================================
build, problem             `build`: a scene -> a discretised problem -> a solver-ready problem
body, conditions, models   meshes, materials, supports, loads and rigid bodies of the substructures
interfaces, face_pairs     points, normals, gaps and traces of the interfaces
checks                     checks of the scene against its meshes
statics                    static equilibrium before t = 0, bodies that nothing holds
run_checks                 slip and rotation beyond the method, resultants of bodies in equilibrium
limit_load                 where contact and friction cannot hold the loads, and what moves then
inactive_substructures     arrival times of waves, classes cut accordingly
bond_groups, bonded_run    bonded bodies as one substructure of the march
merged_assembly            the assembly as one body, where interfaces are perfect
segments                   runs in consecutive pieces of time
propagator_choice          propagators by name; that of the scene, by the memory of its operators
=========================  ============================================================================
"""
