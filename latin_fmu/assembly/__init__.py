"""From the description to operators: the one place that knows both the scene and what is solved.

====================  ==============================================================================
build                 `build`: a scene -> a solver-ready problem
body, conditions,     meshes, materials, supports, loads and rigid bodies of the substructures
rigid, models
pairing, arrival      points of the interfaces, and when something reaches them
statics, static_start equilibrium before t = 0, static scenes
merge                 the assembly as one body, where interfaces are perfect
segments, timeline    load histories, and runs in consecutive pieces of time
cost, run_cost,       predicted memory and time
run_sizes, prediction
====================  ==============================================================================
"""
