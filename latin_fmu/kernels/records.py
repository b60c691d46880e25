"""The memory of a run: pools of numbers, and records with sizes and with the place of every array.

======  =========  ===============================================================  ================================
block   pool       holds                                                            changes
======  =========  ===============================================================  ================================
fixed   constants  factors, K, M, C, compliances, traces, areas, patterns of loads  with the time step
fixed   direction  k, responses Y(k), weights of the error indicator                with the search direction
moving  histories  amplitudes of loads and prescribed motions, motion of grounds    with the segment of time
moving  state      all that the next instant depends on                             every instant
moving  work       scratch of the iteration                                         every iteration; thrown away
moving  output     fields, gaps, probes, sensors, energies of the instants          written once per instant
======  =========  ===============================================================  ================================

A block is one allocation, a pool a range of it; a snapshot is a copy of the range of the state. Blocks are viewed as
float64, int64, uint32 or float32 numbers. A record holds sizes, and for every array the position of its first number in
its block; kernels slice. A record holds no address: blocks can be copied, saved, mapped and shared.

A meaning that begins with a pool is that of an array: pool, kind of number where it is not float64, shape, when it is
there, and the array whose place it takes elsewhere. Places and sizes of the arrays of ``state``, ``work`` and
``output`` are read from here (``propagator.layout``) and stated nowhere else.

Dimensions: n dofs of a member, m members of a class, g interface dofs, c channels of a member, N = n_flat channels of
the assembly, p points of a group, h components per point, T instants of the segment, w instants of the longest window,
R rows of output. Arrays over members have the member as last index. A channel is one interface unknown in the local
frame: a component (N, t1 or t2) at a point of a side.
"""

from __future__ import annotations

from typing import Any, Final

import numpy as np

from . import sparse_response, sums

Field = tuple[str, str]  # name, meaning with shape, pool and unit

DIRECT, EXPLICIT, STATIC = 0, 1, 2
"""Kinds of motion of a class: implicit (a reduced body is one), central differences, without inertia."""

_MATRIX: Final = (
    ("{0}_rows", "rows of {1}, 0 where there is none"),
    ("{0}_starts", "constants, int64 (rows + 1,): first entry of each row of {1}"),
    ("{0}_columns", "constants, uint32: columns of the entries"),
    ("{0}_values", "constants: the entries"),
)
_HALF: Final = (
    *_MATRIX,
    ("{0}_diagonal", "constants (n,): diagonal where only the strict lower triangle is kept"),
    ("{0}_together", "constants, uint32 (n,): rows from each on, 3 at most, with the same columns but for each other"),
    ("{0}_parts", "constants, int64 (PARTS, 3) of classes in pieces: first row, last row + 1, least column of a part"),
)
_TERM: Final = (
    ("{0}_terms", "number of patterns of {1}"),
    ("{0}_starts", "histories, int64 (terms + 1,): first entry of each pattern"),
    ("{0}_rows", "histories, int64: rows x members + member of the entries"),
    ("{0}_values", "histories: the entries"),
    ("{0}_amplitudes", "histories (T, terms): factor of each pattern at the instants"),
)


def _fields(template: tuple[Field, ...], name: str, meaning: str) -> tuple[Field, ...]:
    return tuple((key.format(name), text.format(name, meaning)) for key, text in template)


CLASS_FIELDS: Final[tuple[Field, ...]] = (
    # sizes
    ("n", "dofs of a member"),
    ("m", "members"),
    ("n_inner", "interface dofs g"),
    ("n_channel", "channels c of a member"),
    ("n_live", "channels that can move"),
    ("n_normal", "normal channels among those"),
    ("n_interior", "dofs that the factor eliminates"),
    ("n_super", "supernodes of the factor"),
    ("n_massless", "dofs without mass"),
    ("n_probe", "rows of the probe"),
    ("n_sensor", "rows of the sensors"),
    ("n_motion", "prescribed motions of a member"),
    # kinds
    ("kind", "DIRECT, EXPLICIT or STATIC"),
    ("factored", "1 where the kernels hold the factor; 0 where the caller solves (``callouts``)"),
    ("single", "1 where the panels are float32, 2 where those of ``k_panels`` alone are"),
    ("grouped", "1 where four rows of a panel are taken at a time (factor within the cache)"),
    ("driven", "1 where constant forces or prescribed motions drive the class, and for STATIC classes"),
    ("accounted", "1 where energies are accounted for"),
    ("loads_only", "1 where of the energies the work of the loads alone is followed"),
    ("damped", "1 where C is more than the viscosity of the contact layer"),
    ("dense_trace", "1 where the trace is a dense matrix"),
    ("swept", "1 where the factor holds all dofs and interfaces are solved with by substitution on the face alone"),
    ("plain_inverse", "1 where S^-1 is diagonal"),
    ("plain_response", "1 where Y and C are diagonal"),
    # factor L of the operator of the march, interface dofs last unless ``swept``
    ("order", "constants, int64 (n,): dof of each place in elimination order"),
    ("first", "constants, int64 (n_super + 1,): first column of each supernode"),
    ("row_start", "constants, int64 (n_super + 1,): first row below each supernode"),
    ("rows", "constants, int64: rows below the supernodes"),
    ("n_rows", "their number"),
    ("panel_start", "constants, int64 (n_super + 1,): first number of each panel"),
    ("panels", "constants: panels [L11^-1; L21]"),
    ("n_panels", "their size"),
    ("schur_inverse", "constants (g, g) packed or (g,): S^-1, accelerations of interface dofs per force, kg-1"),
    ("face_start", "constants, int64 (n_super,) of swept classes: first column of each supernode for the face"),
    ("face", "constants, int64 (g,) of swept classes: place of the interface dofs in elimination order"),
    ("component", "constants, int64 (c,) of swept classes: 0 for normal channels, 1 for others"),
    ("k_panels", "direction of swept classes: panels of the operator with the dashpots k on the interfaces"),
    ("n_piece", "pieces, 0 where the factor is small"),
    ("n_level", "levels of the tree of pieces"),
    ("pieces", "constants, int64: n_level + 1 first pieces, then the pieces, then their lists (``splits``)"),
    ("split", "1 where threads share the pieces and products of the class, 0 where each class has one thread"),
    # interface
    ("dofs", "constants, int64 (g,): interface dofs"),
    ("area", "constants (c,): areas, m2"),
    ("channels", "constants, int64 (c, m): place of the channels among those of the assembly"),
    ("divided", "1 where other processes hold members of the class"),
    ("live", "constants, int64 (n_live,): channels that can move"),
    ("measured", "constants, int64 (n_live,): the same, normal ones first"),
    ("compliance", "constants: C = T D T^T between normal, then between tangential channels, m s-1 N-1"),
    ("massless", "constants, int64 (n_massless,): dofs without mass"),
    ("trace_table", "constants (c, g): T where it is dense"),
    ("normal_table", "constants (n_normal, g): its rows of normal channels"),
    ("spread_table", "constants (g, c): its transpose"),
    ("k", "direction (c,): search direction, Pa s m-1"),
    ("response", "direction (n_live, n_live) packed or (n_live,): Y per nodal force, m s-1 N-1"),
    ("admittance", "direction (n_live, n_live) packed or (n_live,): D of Newton steps"),
    ("spring_inverse", "direction (g, g) packed: (S + T^T a k/dt T)^-1 of a STATIC class, m N-1"),
    # state
    ("state", "place of ``rest``, the first number of the class in the state, n_state in all"),
    ("n_state", "their number: rest flag and motion"),
    ("rest", "state (1,): 1 while nothing has moved"),
    ("u", "state (n, m): displacements, m"),
    ("v", "state (n, m): velocities, m s-1"),
    ("a", "state (n, m): accelerations, m s-2"),
    ("residual", "state (n, m): forces of the scheme's memory, N"),
    ("energy", "place of ``totals``, the first number of the account of energies, n_energy in all"),
    ("n_energy", "their number"),
    ("totals", "state (N_TERM, m) if accounted: terms of the account, J (``energy_parts.TERMS``)"),
    ("past", "state (FIELDS, n + n_motion, m) if accounted: fields and forces of the last instants"),
    ("turn", "state (1,) if accounted: which of their three places the forces of the next instant take"),
    # work
    ("marched", "work (1,): substructure-instants marched"),
    ("passed", "work (1,): 1 where the class is passed over at this instant"),
    ("u_free", "work (n, m): displacements without interface forces, m"),
    ("v_free", "work (n, m): velocities likewise, m s-1"),
    ("load", "work (n, m): forces of the instant, N"),
    ("mass_a", "work (n, m): M a, N"),
    ("weighted_v", "work (n, m) if accounted: velocities that C acts on over the step where ``one_step``, m s-1"),
    ("half_solution", "work (n, padded(m)): after the forward substitution, in tiles from TILED members on"),
    ("face_vector", "work (n, max(padded(m), LANES)) if swept: likewise"),
    ("inner", "work (g, m)"),
    ("inner_answer", "work (g, m)"),
    ("free_a", "work (g, m): accelerations of the interface dofs without interface forces, m s-2"),
    ("w_free", "work (c, m): velocities of the channels under the tractions ``reference``, m s-1"),
    ("reference", "work (c, m): those of the last instant with ``from_last``, Pa, 0 without inertia"),
    ("w_damped", "work (c, m) if kind == STATIC else w_free: velocities that the dashpots k act on, m s-1"),
    ("solved_q", "work (w, c, m): q of the last solves, Pa"),
    ("solved_w", "work (w, c, m): W of the last solves, m s-1"),
    ("known", "work (1,): 1 where those are of this window"),
    ("changes", "work (w,) if divided: change of q at all its members since the last solves (``change_of``)"),
    ("kept_states", "work (w // (isqrt(w) + 1) + 1, n_state) if w > 1: states inside a window of several instants"),
    ("channel", "work (c, m)"),
    ("answer", "work (c, m)"),
    ("vectors", "work (2 * m, n_live)"),
    ("answers", "work (2 * m, max(n_live, c))"),
    (
        "tile",
        "work (-(-2 * m // LANES) if m >= TILED else m, max(n, c) + SPARE, LANES): tiles of twice the members from "
        "TILED members on, else members",
    ),
    ("piece_work", "work (PARTS - 1, n, LANES if m >= TILED else 1) if n_piece: vectors of the pieces; products"),
    ("piece_tile", "work (n_piece, SPARE, LANES)"),
    ("solved", "work (1,): substructures solved, or substructure-instants marched, in this iteration"),
    ("class_norms", "work (w, 4): part of the class in ``norms``"),
    ("cross", "work (w,): power of the forces on the velocities that their half residuals give, W"),
    ("extended", "work (4, n + n_motion, m) if accounted: scratch of the account of energies"),
    # histories
    ("constant", "histories (n, m): constant forces, N"),
    ("motions", "histories (3, T, n_motion, m): prescribed displacements, velocities, accelerations"),
    ("work_loads", "histories (n, m): constant part of the loads that work, N"),
    # output
    ("probed", "output (R, n_probe, m): velocities of the probed rows, m s-1"),
    ("sensed", "output (R, 3, n_sensor, m): displacements, velocities, accelerations at the sensors; m, m s-1, m s-2"),
    ("energies", "output (R, N_TERM, m) if accounted: terms of the account, J"),
    *_fields(_HALF, "mass", "M"),
    *_fields(_HALF, "stiffness", "K"),
    *_fields(_HALF, "damping", "the damping C"),
    *_fields(_HALF, "dashpots", "the lumped damping of an EXPLICIT class"),
    *_fields(_HALF, "landing", "the part of C that is the viscosity of the contact layer"),
    *_fields(_MATRIX, "border_mass", "M of prescribed motions with dofs, then among them (n_motion, n + n_motion)"),
    *_fields(_MATRIX, "border_stiffness", "K likewise"),
    *_fields(_MATRIX, "border_damping", "C likewise"),
    *_fields(_MATRIX, "border_dashpots", "lumped damping likewise"),
    *_fields(_MATRIX, "border_landing", "viscosity of the contact layer likewise"),
    *_fields(_MATRIX, "trace", "T from interface dofs to channels"),
    *_fields(_MATRIX, "spread", "T^T"),
    *_fields(_MATRIX, "probe", "velocities kept at every instant, from all dofs"),
    *_fields(_MATRIX, "sensor", "motions kept at every instant, from all dofs"),
    *_fields(_TERM, "force", "the forces on the dofs, prescribed motions included, N"),
    *_fields(_TERM, "inertia", "the inertia of prescribed motions, N"),
    *_fields(_TERM, "velocity", "channel velocities of prescribed motions, m s-1"),
    *_fields(_TERM, "displacement", "their displacements, m"),
    *_fields(_TERM, "acceleration", "their accelerations, m s-2"),
    *_fields(_TERM, "work", "loads alone, that work on the dofs, N"),
    *sparse_response.CLASS_FIELDS,
)
"""A class of identical substructures; the fields of tables of large interfaces are in ``sparse_response``."""

GROUP_FIELDS: Final[tuple[Field, ...]] = (
    ("law", "code of the law (``laws.LAWS``), -1 where the caller has it (``callouts``)"),
    ("elastic", "1 where the law depends on the jump of displacement"),
    ("opens", "1 where the group has gaps"),
    ("start", "first channel of the group: block (2, p, h)"),
    ("n_point", "points p"),
    ("n_component", "components per point h"),
    ("n_parameter", "parameters per point"),
    ("first_point", "number of its first point among those of all groups"),
    ("parameters", "constants (p, n_parameter)"),
    ("initial_gap", "constants (p,): gap along N at t = 0, m"),
    ("z_sum", "direction (p, 2): 1/k of both sides, normal and tangential, m3 N-1 s-1"),
    ("newton_z_sum", "direction (p, 2): the same in a Newton step"),
    ("gap", "state (p,): gap, m"),
    ("layer", "state (p, h) if elastic: jump that the next instant starts from, m"),
    ("keeps_normal", "1 where the law fixes the gap of pressed points, 0 where it reads the displacements"),
    ("keeps_tangential", "1 where the law fixes the place of points that stick"),
    ("drift", "state (3, p, h): jump of the sides over that of the law, m; its velocity, m s-1; acceleration, m s-2"),
    ("planned", "work (3, p, h): the same inside a window as the law makes up for it"),
    ("reach", "work (p, h if elastic else 1): see ``interface.laws``, rule 3"),
    ("jump", "work (p, h): free velocity of E' relative to E, m s-1"),
    ("traction", "work (p, h): on side E, Pa"),
    (
        "opening",
        "work (4, p, h if elastic else 1): opening inside a window, its velocity, acceleration, start of the next "
        "instant",
    ),
    ("opened", "work (4, p, h if elastic else 1): the same at the start of the window"),
    ("tangent", "work (p, 3, 3) if law < 0 or on_iteration: derivative of F_hat by the jump, Pa s m-1"),
)
"""Interfaces of one law and number of components, their points one after the other."""

RUN_FIELDS: Final[tuple[Field, ...]] = (
    ("n_flat", "channels N of the assembly"),
    ("n_class", "classes of the assembly, those of other processes among them"),
    ("threads", "threads of the run"),
    ("team", "work, int64 (MARKS + LINE * tasks,): numbers of the threads (``team``)"),
    ("n_alone", "classes that have one thread each"),
    ("order", "work, int64 (classes,): these classes, in the order of their threads"),
    ("n_point", "points of all groups"),
    ("n_interface", "interfaces"),
    ("n_time", "instants T of the segment"),
    ("first_row", "instant that row 0 of the output holds; it has R rows"),
    ("n_ground", "channels of moving or resting ground"),
    ("depth", "differences kept by the acceleration, 0 for none"),
    ("longest_window", "instants w that fields of work have room for"),
    ("max_iterations", "iterations per window"),
    ("limit", "the same where a fall-back has others, for the action ITERATE"),
    ("observed", "1 where the caller looks at every iterate (``callouts``)"),
    ("tangential", "1 where there are tangential channels"),
    ("layers", "1 where there are elastic groups"),
    ("static", "1 without inertia"),
    ("from_last", "direction: 1 where the tractions of the last instant are among the loads (``reference``)"),
    ("direct_bonds", "1 where q follows from the free velocities at once (``bonds``)"),
    ("n_coarse", "unknowns of the coarse problem, 0 where there is none"),
    ("newton", "1 where Newton steps may end an instant (``newton``)"),
    ("krylov", "1 where active points are solved for by products alone (``krylov``), with ``basis`` ..."),
    ("on_iteration", "1 where the steps are made on the iteration itself (``iteration_step``), with ``basis`` ..."),
    ("n_block", "blocks of the relative operator: interfaces, those that share a substructure near each other"),
    ("n_unknown", "unknowns of the relative operator at most"),
    ("n_matrix", "numbers of its matrix at most, 0 with ``krylov``"),
    ("tied_n", "dofs of the tied assembly that preconditions them (``tied``), 0 where there is none"),
    ("tied_entries", "direction: numbers of its factor that a substitution reads"),
    ("tied_super", "direction: supernodes of its factor, 0 where there is none"),
    ("tied_grouped", "direction: 1 where four rows of its panels are taken at a time"),
    ("tied_first", "direction, int64 (tied_super + 1,): first column of each supernode"),
    ("tied_row_start", "direction, int64 (tied_super + 1,): first row below each supernode"),
    ("tied_rows_below", "direction, int64: rows below the supernodes"),
    ("tied_panel_start", "direction, int64 (tied_super + 1,): first number of each panel"),
    ("tied_face_start", "direction, int64 (tied_super,): first column of each supernode for the interfaces"),
    ("tied_panels", "direction, float32: panels of its factor"),
    ("tied_dashpot", "direction (N,): dashpots per area over z that tie the points, N s m-1 a component"),
    *(
        (k, t.replace("constants", "direction"))
        for k, t in _fields(_MATRIX, "tied", "velocities of the channels from the dofs in elimination order")
    ),
    ("block_low", "constants, int64 (n_block,): first block that a block is coupled with"),
    ("block_high", "constants, int64 (n_block,): last one"),
    ("block_points", "constants, int64 (n_block + 1,): first point of each block in the order of the blocks"),
    ("point_group", "constants, int64 (n_place,): groups of the points in that order, -1 of interfaces held elsewhere"),
    ("point_number", "constants, int64 (n_place,): their numbers in the group"),
    ("owner", "constants, int64 (N,): number of the substructure of each channel, -1 for ground"),
    ("owner_class", "constants, int64 (N,): its class, -1 for ground"),
    ("live_row", "constants, int64 (N,): number of the channel among the live ones of its class, -1 for others"),
    ("area", "constants (N,): areas, m2"),
    ("still", "constants (N,): tractions of the equilibrium that the motion starts from, Pa"),
    ("interface", "constants, int64 (N,): number of the interface"),
    ("ground", "constants, int64 (n_ground,): channels of ground"),
    ("k", "direction (N,): search direction, Pa s m-1"),
    ("z", "direction (N,): 1/k, 0 where k is, m3 N-1 s-1"),
    ("newton_z", "direction (N,): z of the laws in a Newton step"),
    ("weights", "direction (4, N): of r^2, F^2, W^2 and (W' - W)^2 in the error indicator"),
    ("metric", "direction (N,): squared weights of q in the acceleration"),
    ("bonds", "direction (N, N): q from the free velocities where all interfaces are perfect"),
    ("coarse_inverse", "direction (n_coarse_here, n_coarse)"),
    *(
        (k.replace("constants", "direction"), t.replace("constants", "direction"))
        for k, t in (
            *_fields(_MATRIX, "coarse_balance", "sums of forces over the sides of the interfaces (n_coarse_own, N)"),
            *_fields(_MATRIX, "coarse_incoming", "q of coarse motions (N, n_coarse_here)"),
            *_fields(_MATRIX, "coarse_answer", "W of coarse motions (N, n_coarse_here)"),
        )
    ),
    ("ground_velocity", "histories (T, n_ground), m s-1"),
    ("ground_displacement", "histories (T, n_ground), m, ahead by ``gap_offset``"),
    ("ground_layer", "histories (T, n_ground): what elastic groups start from, m"),
    ("continuation", "histories (T,): how far the loads go on as they did, without inertia; 0 ... 1"),
    ("ground_acceleration", "histories (T, n_ground), m s-2"),
    ("f_hat", "state (N,): tractions of the last instant, Pa"),
    ("w_hat", "state (N,): velocities likewise, m s-1"),
    ("scales", "state (3,): largest norms met: fields, normal and tangential forces"),
    ("carry", "state (1,): share of the last velocities in the first guess of the next instant"),
    ("finish", "state (N_FINISH,): end of the last instant by a Newton step, see ``newton.keep_course``"),
    ("worst", "state (n_interface,): largest indicator of each interface"),
    (
        "works",
        "state (N_WORK,): of the energy put in and of the drift, J (``energy_parts.STORED`` and those behind it)",
    ),
    ("counts", "work (2,): substructure-instants marched in windows of several instants, and solved through Y"),
    ("q", "work (w, N): incoming quantity F + k W, Pa"),
    ("w", "work (w, N): velocities of the linear stage, m s-1"),
    ("f", "work (w, N): tractions of the linear stage, Pa"),
    ("s", "work (w, N): W - F / k, m s-1"),
    ("local_f", "work (w, N): tractions of the local stage, Pa"),
    ("local_w", "work (w, N): velocities of the local stage, m s-1"),
    ("r", "work (w, N): residual F_hat + k W_hat - q, Pa"),
    ("last_q", "work (w, N)"),
    ("last_r", "work (w, N)"),
    ("dq", "work (depth, w, N): differences of iterates"),
    ("dr", "work (depth, w, N): differences of residuals"),
    ("gram", "work (depth, depth): their weighted products"),
    ("least", "work (depth + 3, depth): scratch of the least-squares problem"),
    ("displacement", "work (N,): displacements that gaps are read from, m"),
    ("moved", "work (N,): velocities at the end of an instant under the tractions that acted, m s-1"),
    ("layer", "work (N,): displacements that layers start from, m"),
    ("shares", "work (n_interface,)"),
    (
        "norms",
        "work (4 * w + 1,): squared norms of forces and of half residuals, normal and tangential; sum of ``cross``",
    ),
    ("merits", "work (3 * max_iterations + 64, 2): distance of each iterate from the tolerance, by eta, with residual"),
    (
        "measure",
        "work (9,): error, force residual, scales reached (3), ratio of merits, scale of the best iterate, share of "
        "the tractions that changes, work of the error over that allowed",
    ),
    ("course", "work (N_COURSE,): course of Newton's method at this instant (``newton``)"),
    ("best_q", "work (N,) if n_unknown or on_iteration: q of the best iterate"),
    ("step_f", "work (N,) if n_unknown: change of the tractions in a Newton step, Pa"),
    ("step_w", "work (N,) if n_unknown: change of the velocities, m s-1"),
    ("old_q", "work (N,) if n_unknown or on_iteration: q at the start of a Newton step"),
    ("old_w", "work (N,) if n_unknown or on_iteration: W there"),
    ("new_q", "work (N,) if n_unknown or on_iteration: q at its end"),
    ("new_w", "work (N,) if n_unknown or on_iteration: W there"),
    ("unknown_of", "work, int64 (n_place + 1,): first unknown of each point in the order of the blocks"),
    ("unknown_start", "work, int64 (n_block + 1,): first unknown of each block"),
    ("row_at", "work, int64 (n_unknown,): place of the rows of the matrix"),
    ("pivots", "work, int64 (n_unknown,): rows exchanged"),
    ("columns", "work (n_unknown + 3, 3): columns of the unknowns at their points"),
    ("rows", "work (n_unknown + 3, 3): their rows"),
    ("softness", "work (n_unknown + 3, 3): what they add to the matrix within their points"),
    ("unknowns", "work (n_unknown + 3,): right-hand side and solution"),
    ("block", "work (9,)"),
    ("elimination", "work (SCRATCH,): scratch of the elimination"),
    ("matrix", "work (n_matrix,): matrix of the active points and its factors"),
    ("factored", "work (1,): 1 where it holds the factors for the tangents below"),
    ("factored_of", "work, int64 (n_place + 1,): ``unknown_of`` of these"),
    ("factored_tangents", "work (3, 3 * n_unknown + 9): their columns, rows and softness"),
    ("basis", "work (VECTORS + 1, n_unknown if krylov else N) if krylov or on_iteration: vectors of the method"),
    (
        "krylov_work",
        "work (SMALL + max(3 * n_unknown, POINT),) if krylov or on_iteration: coefficients; diagonal preconditioner, a "
        "product, solution; or scratch of a point",
    ),
    ("tied_vector", "work (tied_n,) if krylov: a vector of the tied assembly"),
    ("errors", "output (R, max_iterations): sqrt(eta) of the iterations"),
    ("force_residuals", "output (R, max_iterations): force residual of the iterations"),
    ("iterations", "output, int64 (R,)"),
    ("newton_steps", "output, int64 (R,): iterations that were Newton steps"),
    ("history_f", "output (R, N): accepted tractions, Pa"),
    ("history_w", "output (R, N): accepted velocities, m s-1"),
    ("history_gap", "output (R, n_point): gaps, m"),
    ("history_works", "output (R,): work of the drift on the interfaces owned here since the start, J"),
    ("state_size", "numbers of the state, which the moving block begins with"),
    ("n_input", "amplitudes set from outside; this and all below 0 but in a co-simulation (``communication``)"),
    ("n_source", "amplitudes that drive the run: those, then laws of the scene that vary"),
    ("n_motion_state", "numbers that prescribed motions (u, v, a of each class) and the ground (u, a) go on from"),
    ("n_drive", "drives: the motion state, sources before the time step, sources at its end, 1"),
    ("n_signal", "numbers that outputs follow from: tractions, velocities, gaps, sensors, probes, drives, energies"),
    ("n_output", "outputs, scalars"),
    ("law_first", "time steps before the first row of the table of own laws"),
    ("law_end", "time steps that the table holds, -1 where the last row holds ever after"),
    ("by_caller", "1 where the caller solves the windows of communication steps"),
    ("n_integral", "outputs that are integrals of others over time"),
    ("of_solver", "place of the outputs iterations, indicator, converged, time steps, instant"),
    ("of_energy", "place of the energies among the signals, -1 where there are none (``outputs.ENERGIES``)"),
    ("of_event", "place of the outputs of contact events (``outputs.follow_events``)"),
    ("input_kind", "constants, int64 (n_input,): ``inputs.LOAD``, MOTION, DISPLACEMENT or WAVE"),
    ("input_start", "constants (n_input,): amplitude that the initial state of the image is for"),
    ("input_held", "constants, int64 (n_input,): ``communication.FREE``, BY_VALUE or BY_BOTH"),
    ("law_table", "constants (max(law_end, 0) + 1, n_source - n_input)"),
    ("opening_place", "constants, int64 (opening_rows,): places in u, v, a, residual of classes, f_hat, w_hat"),
    ("summary", "constants, int64 (n_interface, N_SUMMARY): see ``outputs.READ``"),
    ("n_constant", "outputs whose derivatives by inputs are 0"),
    ("constant_outputs", "constants, int64 (n_constant,): their places"),
    ("integrals", "constants, int64 (n_integral, 2): place of an output, and of its integral"),
    ("area_share", "constants (n_point,): share of the area of the interface"),
    *_fields(_MATRIX, "column", "the columns (sums and motions of the classes, ground) of a time step from its drives"),
    *_fields(_MATRIX, "motion", "the motion state after a time step from its drives"),
    *_fields(_MATRIX, "first_column", "columns at t = 0 from the drives of the first time step"),
    *_fields(_MATRIX, "first_motion", "motion state at t = 0 likewise"),
    *_fields(_MATRIX, "opening", "the initial state that depends on inputs likewise"),
    *_fields(_MATRIX, "start_column", "columns at the start of a communication step, without inertia, likewise"),
    *_fields(_MATRIX, "output", "outputs from signals"),
    *_fields(_MATRIX, "field", "numbers of the points from signals"),
    *_fields(_MATRIX, "shear", "tangential resultants (3 n_interface,) from signals"),
    ("status_place", "constants, int64 (n_interface,): numbers of the points that are contact states, -1 for none"),
    ("force_products", "constants: per class (force_terms, force_terms), products of its patterns, without inertia"),
    ("inputs", "state (7, n_input): what communication steps have left (``inputs``)"),
    ("motion_state", "state (n_motion_state,)"),
    ("integral", "state (n_integral,): running integrals of outputs"),
    ("present", "state (n_output,): outputs now"),
    (
        "event_rates",
        "state (n_interface, 2) if n_output: rates of pressure N, N/s, and of |T| / N, s-1, over the last time step",
    ),
    ("progress", "state (9,) if n_output: see ``communication``"),
    ("place", "work (3,) if n_output: end and length of the next communication step, and round-off, time steps"),
    ("input_value", "work (n_input,): amplitudes set for the communication step"),
    ("input_rate", "work (n_input,): their rates, s-1"),
    ("next_state", "work (n_motion_state,)"),
    ("signal", "work (n_signal,)"),
    ("column", "work (column_rows,)"),
    ("last_columns", "work (2, column_rows): of the instant before, change to it, without inertia"),
    ("opening", "work (opening_rows,)"),
    ("drive", "output (R, n_drive)"),
    ("field", "work (field_rows,)"),
    ("shear", "work (n_interface, 3) if n_output: tangential resultants, N"),
    ("friction_ratio", "output (R, n_interface) if n_output: |T| / N"),
    ("output", "output (R, n_output): row 0 at the start of the call"),
    *sparse_response.RUN_FIELDS,
    *sums.RUN_FIELDS,
)
"""The run as a whole: sizes and arrays."""

RUN_NUMBERS: Final[tuple[Field, ...]] = (
    ("dt", "time step, s"),
    ("u_v", "weight of v in u_free, s"),
    ("u_a", "weight of a in u_free, s2"),
    ("v_a", "weight of a in v_free, s"),
    ("velocity_gain", "dv/da, s"),
    ("displacement_gain", "du/da, s2"),
    ("interface_gain", "dW/da, s"),
    ("force_weight", "weight of the forces of the new instant, tractions apart"),
    ("memory_weight", "weight of the residual of the old instant"),
    ("mass_weight", "weight of M a of the new instant"),
    ("mass_old", "weight of M a of the old instant where the scheme takes it by its own"),
    ("force_old", "weight of f - C v - K u of the old instant likewise; 0: of the residual"),
    ("traction_weight", "weight of the tractions of the new instant"),
    ("w_u_old", "weight of the old u in W, s-1"),
    ("w_u", "weight of u_free in W, s-1"),
    ("w_v", "weight of v_free in W"),
    ("u_late", "weight of v_free in the new displacement, s"),
    ("gap_offset", "how far ahead displacements are that gaps are read from, s"),
    ("layer_v", "weight of v in what layers start from, s"),
    ("layer_a", "weight of a in what layers start from, s2"),
    ("layer_rate", "1 / (displacement of layers per velocity of the new instant), s-1"),
    ("opening_v", "weight of the old opening velocity in the new opening, s"),
    ("opening_a", "weight of the old opening acceleration, s2"),
    ("opening_new", "weight of the new opening velocity, s"),
    ("rate_v", "weight of the old opening velocity in the new opening acceleration, s-1"),
    ("rate_a", "weight of the old opening acceleration"),
    ("rate_new", "weight of the new opening velocity, s-1"),
    ("energy_before", "weight of the forces of instant n - 1 in the work of the step n, n + 1"),
    ("energy_old", "weight of those of n"),
    ("energy_new", "weight of those of n + 1"),
    ("traction_before", "weight of the tractions of n - 1 in their work"),
    ("traction_old", "weight of those of n"),
    ("traction_new", "weight of those of n + 1"),
    ("energy_a_old", "weight of the old acceleration in the work of inertia"),
    ("energy_a_new", "weight of the new one"),
    ("inertia_dissipation", "factor of a_w . M Da in the energy of the scheme, s2"),
    ("inertia_drift", "factor of the mean v . M Da, s"),
    ("one_step", "1 where C v of the energies is that of ``weighted_v``"),
    ("deepest", "gaps below count as this one, m"),
    ("make_up", "share of the drift that is made up in an instant, over dt, s-1 (``local_stage.follow_drift``)"),
    ("tolerance", "on sqrt(eta)"),
    ("force_tolerance", "on the force residual"),
    ("relaxation", "factor on the residual"),
    ("proximal", "share of z added to the diagonal of the relative operator"),
    ("longest_step", "longest step of the acceleration in lengths of the residual"),
    ("newton_price", "cost of a Newton step in iterations, by products that of one product"),
    ("rest_traction", "classes at rest stay there up to this traction, Pa; below 0: none does"),
    ("reuse", "squared relative change of q up to which a solve is reused; below 0: never"),
    ("no_contact", "traction up to which a point counts as separated in the outputs, Pa"),
)
"""The run as a whole: the time scheme for the step, and the rules of the iteration."""


def _dtype(integers: tuple[Field, ...], numbers: tuple[Field, ...] = ()) -> np.dtype[Any]:
    fields = [(name, np.int64) for name, _ in integers] + [(name, np.float64) for name, _ in numbers]
    return np.dtype(fields)


CLASS: Final = _dtype(CLASS_FIELDS)
GROUP: Final = _dtype(GROUP_FIELDS)
RUN: Final = _dtype(RUN_FIELDS, RUN_NUMBERS)
