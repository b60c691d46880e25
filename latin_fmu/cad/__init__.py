"""CAD assemblies as meshes and scenes.

============  =================================================================================================
facts         parts, round faces, pairs and screws of an assembly as plain data
labels        names of parts from their paths, the same when the file is read again
step_text     unit, materials and densities from the text of a STEP file
geometry      solids of a file by gmsh
neighbours    parts that touch, are apart or overlap
screws        screws among the parts, their threads and what they clamp
cutting       half models: parts cut by planes of symmetry
imprint       faces split along the outline of what touches them
meshing       how fine, second order, names of faces
sizes         sizes of edges as a field of the library
repair        cells that are inside out
making        all of this in a row, in the process of gmsh
from_mesh     parts of a mesh that comes from elsewhere
scene_text    the scene that a user goes on with
record        what a mesh was made from, and what has changed since
report        what the command prints
============  =================================================================================================

gmsh has the licence GPL: it is in the extra ``meshes`` alone, and geometry, neighbours, cutting, imprint, meshing,
sizes, repair and making run in a process of their own (``mesh_files.child``), which has a limit of processor time and
may die.
"""
