"""Derivatives of a run by parameters of its scene: by tangents, and by scenes that differ in numbers.

===========  ==================================================================
tangents     derivatives of static start, tightening and march
tangent_run  the march of the derivatives beside that of the run
copies       scenes that differ in numbers, marched side by side as one assembly
===========  ==================================================================
"""
