"""Numbers of arrays in the moving block that some runs alone have (``kernels.records``)."""

from __future__ import annotations

from typing import Any

Fields = dict[str, Any]


def communication_state(run: Fields, n_interface: int) -> dict[str, int]:
    """Numbers of the arrays of the state of a co-simulation; none elsewhere."""
    if not run.get("n_output", 0):
        return {}
    inputs, motion, outputs = (run.get(name, 0) for name in ("n_input", "n_motion_state", "n_output"))
    sizes: dict[str, int] = dict.fromkeys(("reached", "slope", "before", "held", "rated"), inputs)
    sizes |= {"motion_state": motion, "impulse": 3 * n_interface, "present": outputs, "progress": 8}
    return sizes | {"event_rates": 2 * n_interface}


def sums(run: Fields, n_interface: int) -> dict[str, int]:
    """Numbers of the arrays for sums over the assembly."""
    shared, width, coarse = run.get("shared", 0), int(run.get("part_width", 0)), int(run.get("n_coarse", 0))
    sizes = {"parts": width * int(run.get("n_part", 0)), "own_parts": width * n_interface * shared, "totals": width}
    here, own = int(run.get("n_coarse_here", 0)), int(run.get("n_coarse_own", 0))
    return sizes | {"coarse": coarse + here, "coarse_parts": 2 * coarse, "coarse_own": own * shared}


def messages(run: Fields, window: int, n_class: int) -> dict[str, int]:
    """Numbers of the arrays that the processes of a run exchange; none of one process."""
    if not run.get("shared", 0):
        return {}
    fields = max(window, 2 + run["layers"])
    sizes = {"outbox": fields * run["n_send"], "inbox": fields * run["n_take"], "acting": 1}
    return sizes | {"own_norms": 4 * window * (n_class + 1), "all_norms": 4 * window * run["n_norm"]}


def communication_work(run: Fields) -> dict[str, int]:
    """Numbers of the work arrays of a co-simulation but those with a row an instant."""
    sizes = {"input_value": run.get("n_input", 0), "input_rate": run.get("n_input", 0)}
    sizes |= {"next_state": run.get("n_motion_state", 0), "signal": run.get("n_signal", 0)}
    sizes |= {"column": run.get("column_rows", 0), "last_columns": 2 * run.get("column_rows", 0)}
    sizes |= {"shear": 3 * run.get("n_interface", 0) * min(run.get("n_output", 0), 1)}
    return sizes | {"opening": run.get("opening_rows", 0), "field": run.get("field_rows", 0)}
