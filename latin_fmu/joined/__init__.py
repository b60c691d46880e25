"""The assembly as one system: bonds eliminated, its modes, and marches over all bodies at once.

=================================  ====================================================================
tied_assembly                      motions of the bodies by free dofs and relative motions of the contacts
hierarchical_dofs                  dofs of contact faces of second order that belong to one point each
static_assembly, bond_forces       its solution without inertia; tractions of the bonds
joined_assembly                    joints that are linear: open, sticking or bonded; modes
stress_ratios                      how much stress changes its stiffness, and whether it has buckled
dynamic_stiffness, modal_damping   stiffness that depends on frequency, damping ratios of modes
damping_band                       the band in which [damping] holds its ratio
bond_groups, bonded_run, fields    bonded bodies as one substructure of the march
reduced_assembly, reduced_run      modes and relative motions of the contacts, and their march
rigid_parts, modal_problem         inertia of parts that move as a whole; a scene made into such a march
motion_rows, recovered_fields      rows of the motion of the bodies; their fields from that march
recovered_energies                 energies of the whole assembly
recovered_resultants               what a study reads: contacts, sensors, resultants of bonds
=================================  ====================================================================
"""
