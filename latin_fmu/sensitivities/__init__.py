"""Derivatives of a run by parameters of its scene: by tangents, and by scenes that differ in numbers.

================  ==================================================================
tangents          derivatives of static start, tightening and march
data_changes      what a parameter changes in loads, initial values, gaps and laws
reduced_tangents  derivatives of a march by the modes of an assembly
tangent_run       the march of the derivatives beside that of the run
copies            scenes that differ in numbers, marched side by side as one assembly
================  ==================================================================
"""
