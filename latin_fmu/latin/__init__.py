"""The LATIN method: two groups of equations, two search directions, over windows of time, Eqs. (8)-(17), (24).

What is computed stands in ``kernels``; here is what a run holds, chooses and keeps.

===================================================  ==================================================================
assembly, initial_conditions                         substructures and interfaces of a run; its fields at t = 0
settings, search_direction                           tolerances, relaxation, ...; k, and the weights of eta
run_image                                            the run as the kernels take it, relaxation after a stall
windows, run_state                                   from 0 to T window by window; the state between them
solver, instant_solve, sliding_start                 a window that stalls: fall-backs, softened start, point by point
coarse_problem, tied_bodies                          balance of bodies without inertia; preconditioner of Newton steps
recorder, interface_rows, probes                     what is kept of a run; of interfaces, of sensors and bolts
outcome, status, bolt_sections                       its histories as arrays; how the iteration went; shanks of bolts
part, processes, exchange                            substructures over several processes (MPI)
state_serialization                                  states as bytes and back
===================================================  ==================================================================
"""
