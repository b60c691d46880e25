"""Row of the table of classes; see ``classes``."""

from __future__ import annotations

from .views import record

_MATRICES = ("mass", "stiffness", "damping", "trace", "spread", "probe")
_TERMS = ("force", "inertia", "velocity", "displacement", "acceleration")
STATE = ("u", "v", "a", "residual")
# scratch: name -> rows (per member)
SCRATCH = (
    "u_free",
    "v_free",
    "load",
    "sweep",
    "inner",
    "inner_answer",
    "free_a",
    "w_free",
    "seen",
    "channel",
    "answer",
)

CLASS = record(
    [
        "n", "m", "n_inner", "n_channel", "n_live", "n_normal", "n_interior", "n_super", "n_massless", "n_probe",
        "tallest", "grouped", "driven", "routines", "first", "row_start", "rows", "panel_start", "panels", "n_rows",
        "n_panels", "order", "schur_inverse", "dofs", "area", "live", "measured", "massless", "k", "response",
        "compliance", "channels", "below", "rest", "constant", "probed", "plain_inverse", "plain_response",
        "dense_trace", "trace_table", "normal_table", "spread_table",
        *STATE, *SCRATCH, "vectors", "answers", "tile",
        *(f"{m}_{part}" for m in _MATRICES for part in ("n", "diagonal", "starts", "columns", "values")),
        *(f"{t}_{part}" for t in _TERMS for part in ("n", "starts", "rows", "values", "amplitudes")),
    ]
)  # fmt: skip
"""One row per class. ``n`` dofs, ``m`` members, ``n_inner`` interface dofs, ``n_live`` channels that can move; arrays
per dof are (n, m). Matrices are compressed rows (``starts``, ``columns``, ``values``; mass, stiffness, damping: see
``products.add_symmetric``; dense ones: see ``products.dense``; C: its block between normal channels, then that between
tangential ones, both in the order of ``measured``), terms likewise (see ``Terms``). ``rest`` is 1
while the class has not moved, and 1 where it is passed over at this instant, ``driven`` 1 where more than loads that
come and go drives it. ``plain_inverse``, ``plain_response``: the Schur inverse, Y and C by their diagonals;
``dense_trace``: trace, its rows for normal channels, and transpose dense."""
