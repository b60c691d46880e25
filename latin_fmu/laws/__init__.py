"""Laws of interfaces, one file each: value, tangent, status and parameters; ``dispatch`` has their registry.

``parts`` has what they share: Coulomb's friction under a pressure, Eqs. (21)-(23), and unknowns of tangents; ``base``
what a law declares.
"""
