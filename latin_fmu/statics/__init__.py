"""Equilibria: before the motion, and of scenes without inertia.

================================  =====================================================================
starts                            the state a run starts from: press fits, tight bolts, then loads of t = 0
statics, bolt_ends                each of these three as a static problem; what holds the ends of bolts
equilibrium                       a static problem solved to the end of its increments, and its tolerances
static_run, static_fields         the same over the whole assembly at once, and the fields of its bodies
free_bodies, falling_bodies       bodies that nothing holds, or that fall on what catches them
prestressed, loads_at_start       geometric stiffness of the state at t = 0, and whether it has buckled
displaced_starts, places_at_rest  initial displacements added; places that an equilibrium leaves open
================================  =====================================================================
"""
