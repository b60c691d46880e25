"""Equilibria: before the motion, and of scenes without inertia.

================================  =====================================================================
statics, bolt_ends                static start, tightening of bolts, and what holds their ends
equilibrium                       a static problem solved to the end of its increments
static_run, static_fields         the same over the whole assembly at once, and the fields of its bodies
free_bodies, falling_bodies       bodies that nothing holds, or that fall on what catches them
displaced_starts, places_at_rest  initial displacements added; places that an equilibrium leaves open
================================  =====================================================================
"""
