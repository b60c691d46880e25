"""Checks of a scene before a run, and of the run at its end.

=====================  ==================================================================
mesh_checks            a scene against its meshes; size and locking of its bodies
plausibility           numbers that a scene may have but hardly means
drag, joint_rotations  damping and joints that would resist a motion of a rigid body
release                what holds the sides of a joint together
lost_stress            stress of t = 0 that is gone at the end, or that would have righted less
run_checks             whether the end of a run can be trusted; limits of the method
=====================  ==================================================================
"""
