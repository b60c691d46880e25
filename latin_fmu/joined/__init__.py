"""The assembly as one system: bonds eliminated, its modes, and marches over all bodies at once.

=================================  ====================================================================
tied_assembly                      motions of the bodies by free dofs and relative motions of the contacts
static_assembly, bond_forces       its solution without inertia; tractions of the bonds
joined_assembly                    joints that are linear: open, sticking or bonded; modes
dynamic_stiffness, modal_damping   stiffness that depends on frequency, damping ratios of modes
damping_band                       the band in which [damping] holds its ratio
bond_groups, bonded_run, fields    bonded bodies as one substructure of the march
reduced_assembly, reduced_run      modes and relative motions of the contacts, and their march
recovered_fields, modal_problem    fields of the bodies from that march; a scene made into one
=================================  ====================================================================
"""
