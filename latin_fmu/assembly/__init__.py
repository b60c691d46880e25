"""From the description to operators: the one place that knows both the scene and what is solved.

========================  ==========================================================================
build, problem            `build`: a scene -> a discretised problem -> a solver-ready problem
body, conditions, models  meshes, materials, supports, loads and rigid bodies of the substructures
interfaces, face_pairs    points, normals, gaps and traces of the interfaces
checks, scales            checks of the scene against its meshes; impedances and tractions
statics                   equilibrium before t = 0, static scenes
inactive_substructures    when something reaches each substructure
merged_assembly           the assembly as one body, where interfaces are perfect
segments                  runs in consecutive pieces of time
propagator_choice         propagator of the scene, by the memory of its operators
========================  ==========================================================================
"""
