"""Reference solutions that share no code with the package under test.

``bars``       exact travelling waves in bars and shear columns in series (contact, friction, gravity), on
               ``piecewise`` functions and ``connections``; ``balances`` their energy and momentum;
``cases``      the verification problems of one dimension, ready to run;
``histories``  exact norms of the distance between a computed history and an exact one;
``hexahedra``  a plain assembly of 8-node bricks; ``monolithic`` marches a merged mesh;
``contact``    frictional contact of one instant by Newton and block Gauss-Seidel; ``contact_march``
               the transient built on it;
``sliding_block``  the rigid block under 8 cos t.
"""
