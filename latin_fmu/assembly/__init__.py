"""The assembly that a scene describes: its bodies, conditions and interfaces on their meshes, and their problem.

======================================  ===============================================================
body, attachments                       meshes, matrices; point masses, springs and couplings
supports, conditions, driven_starts     what holds and drives a body
interfaces, face_pairs, clearances      points, normals, gaps and traces of the interfaces
threads, press_fits                     screws as CAD draws them; faces that overlap
bolts, bolt_cuts, shank_facets          shanks that are cut and tightened, and where they are cut
bolt_sections                           sections of shanks, and what these clamp
bolt_shares, yielding_bolts             parts of screws; screws that yield
models, propagator_choice               classes of equal substructures and their operators
problem, timeline, initial_state        discretised and solver-ready problem, what drives it, its start
start_contacts, rigid_landings          contacts at the start, impacts without an answer
merged_assembly, whole_march            bonded bodies as one; what a march over all bodies needs
inactive_substructures, untouched       bodies at rest that a run leaves out
======================================  ===============================================================
"""
