"""Laws of interfaces, one point at a time: traction on side E from the relative free velocity of the sides.

At one instant, with s = W - F / k on each side (the velocity it would take without traction), z = 1/k summed over both
sides and the opening velocity d = (s' - s) - z F_hat, a law is a relation between F_hat and d, N from E to E'. Its
explicit solution, point by point, is the local stage (15)-(17). Components are N, t1, t2 (N alone where h = 1).

A law is one file here: three kernels, and a class with its parameters and what the solver has to know of it
(``base.PointLaw``). REGISTRY names the classes; the dispatch by code is made from it.

    value(point, traction)
    tangent(point, unknowns) -> number of unknowns
    point_status(traction, parameters, no_contact) -> SEPARATION, STICK or SLIP

    point        ``parts.PointState``: what the law knows of the point
    traction     (h,) F_hat, Pa; ``value`` writes it
    unknowns     ``parts.Unknowns``: of the tangent, which ``tangent`` writes
    parameters   of the law
    no_contact   traction up to which a point counts as separated, Pa
"""

from __future__ import annotations

from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from ..compiled import entry, kernel
from .base import PointLaw, Status
from .contact import Contact
from .elastic_layer import ElasticLayer
from .maxwell_joint import MaxwellJoint
from .no_slip import NoSlip
from .parts import PointState, Unknowns
from .perfect import Perfect
from .soft_contact import SoftContact
from .viscous_joint import ViscousJoint

Array = NDArray[np.float64]

REGISTRY: Final[tuple[type[PointLaw], ...]] = (
    Perfect,
    Contact,
    NoSlip,
    ElasticLayer,
    SoftContact,
    ViscousJoint,
    MaxwellJoint,
)
"""The laws of the package; the place of a law is its code."""
LAWS: Final = {law.name: code for code, law in enumerate(REGISTRY)}
"""Code of each compiled law, by its name."""
NO_SLIP: Final = LAWS[NoSlip.name]


def _dispatch(kernel_name: str, arguments: str, unknown: str) -> Any:
    """Kernel that calls the kernel of this name of the law with a code, and does ``unknown`` for a code without one.

    It is written out as a chain of branches, since a compiled function takes no table of functions.
    """
    lines = [f"def {kernel_name}(law, {arguments}):"]
    namespace: dict[str, Any] = {"__name__": __name__, "nan": np.nan}
    for code, law in enumerate(REGISTRY):
        namespace[law.name] = getattr(law, kernel_name)
        lines.append(f"    if law == {code}:\n        return {law.name}({arguments})")
    # no text from outside: names are those of REGISTRY
    exec(compile("\n".join([*lines, f"    {unknown}"]), __file__, "exec"), namespace)
    return kernel(namespace[kernel_name])


apply = _dispatch("value", "point, traction", "traction[:] = nan")
"""F_hat (h,) of a point (``PointState``) by the law with a code, written to ``traction``."""
_tangent_of = _dispatch("tangent", "point, unknowns", "return 0")
contact_status = _dispatch("point_status", "traction, parameters, no_contact", "return -1")
"""Separation 0, stick 1, slip 2 of a point from F_hat (h,)."""


@kernel
def tangent(law: int, point: PointState, derivative: Array, unknowns: Unknowns) -> int:
    """Tangent J = dF_hat / djump of a law at one point, as a sum over unknowns (``parts``); their number, 0 ... 3.

    A law written in Python has its derivative (3, 3) instead: columns J, rows of the identity and softness 1 - z J.
    """
    for e in range(9):
        # laws write the entries that are not 0
        unknowns.columns[e] = unknowns.rows[e] = 0.0
    # softness is not cleared before: a given tangent writes all nine
    if law < 0:
        return _given_tangent(derivative, point, unknowns)
    # ``derivative`` may be this array: laws with a code do not read it
    unknowns.softness[:] = 0.0
    return int(_tangent_of(law, point, unknowns))


@kernel
def _given_tangent(derivative: Array, point: PointState, unknowns: Unknowns) -> int:
    """Unknowns of a given derivative (3, 3): as many as there are components, none where it vanishes."""
    softness = unknowns.softness
    largest = 0.0
    for e in range(9):
        largest = max(largest, abs(derivative[e]))
    if largest == 0.0:
        softness[:] = 0.0
        return 0
    for i in range(3):
        for j in range(3):
            # column i of J is what unknown i does: J and its rows exchanged
            unknowns.columns[3 * i + j] = derivative[3 * j + i]
            softness[3 * i + j] = -point.z[min(i, 1)] * derivative[3 * i + j]
        unknowns.rows[4 * i] = 1.0
        softness[4 * i] += 1.0 + unknowns.proximal
    return len(point.jump)


@entry("i8, f8[:, ::1], f8[:, ::1], f8[:, ::1], f8, f8[:, ::1], f8[:, ::1]")
def apply_to_points(law: int, jump: Any, z: Any, reach: Any, rate: float, parameters: Any, traction: Any) -> None:
    """The law with this code at all points; arrays (n_point, ...)."""
    for p in range(len(jump)):
        apply(law, PointState(jump[p], z[p], reach[p], rate, parameters[p]), traction[p])


@kernel
def add_tangent(law: int, point: PointState, scratch: Array, out: Array) -> None:
    """Add J = dF_hat / djump of a law at one point to ``out`` (h * h,), row after row; ``scratch`` (27,)."""
    unknowns = Unknowns(scratch[:9], scratch[9:18], scratch[18:27], 0.0)
    columns = unknowns.columns
    rows = unknowns.rows
    h = len(point.jump)
    for i in range(tangent(law, point, unknowns.softness, unknowns)):
        divisor = unknowns.softness[4 * i] + (point.z[0] if rows[3 * i] != 0.0 else point.z[1])
        # 0: both sides are held
        for a in range(h if divisor != 0.0 else 0):
            for b in range(h):
                out[a * h + b] += columns[3 * i + a] * rows[3 * i + b] / divisor


@entry("i8, f8[:, ::1], f8[:, ::1], f8[:, ::1], f8, f8[:, ::1], f8[::1], f8[:, ::1]")
def tangents_of_points(
    law: int, jump: Any, z: Any, reach: Any, rate: float, parameters: Any, scratch: Any, out: Any
) -> None:
    """``add_tangent`` of the law at all points; arrays (n_point, ...)."""
    for p in range(len(jump)):
        add_tangent(law, PointState(jump[p], z[p], reach[p], rate, parameters[p]), scratch, out[p])


@entry("i8, f8[:, ::1], f8[:, ::1], f8, i8[::1]")
def status_of_points(law: int, traction: Any, parameters: Any, no_contact: float, out: Any) -> None:
    """Status of all points by the law with this code; arrays (n_point, ...)."""
    for p in range(len(traction)):
        out[p] = contact_status(law, traction[p], parameters[p], no_contact)


def law_tangents(law: int, jump: Array, z: Array, reach: Array, rate: float, parameters: Array) -> Array:
    """Derivatives (n_point, h, h) of the tractions of ``apply_law`` by ``jump``; arguments as there."""
    n, h = jump.shape
    out = np.zeros((n, h * h))
    reach = reach if reach.ndim == 2 else reach[:, None]
    jump, z, reach, parameters = (np.ascontiguousarray(x, dtype=float) for x in (jump, z, reach, parameters))
    tangents_of_points(law, jump, z, reach, float(rate), parameters, np.zeros(27), out)
    return out.reshape(n, h, h)


def apply_law(name: str, jump: Array, z: Array, reach: Array, rate: float, parameters: Array) -> Array:
    """Tractions (n_point, n_component) on side E by the law of this name; arguments as for
    ``interface.laws.Behaviour.local``."""
    traction = np.zeros_like(jump, dtype=float)
    reach = reach if reach.ndim == 2 else reach[:, None]
    jump, z, reach, parameters = (np.ascontiguousarray(x, dtype=float) for x in (jump, z, reach, parameters))
    apply_to_points(LAWS[name], jump, z, reach, float(rate), parameters, traction)
    return traction


def statuses(name: str, traction: Array, parameters: Array) -> Status:
    """Status of points that carry these tractions by the law of this name; leading axes free, the last two of points
    (one row of parameters each) and components."""
    flat = np.ascontiguousarray(traction, dtype=float).reshape(-1, traction.shape[-1])
    # rows of points repeat for every instant in front of them
    repeated = np.tile(np.ascontiguousarray(parameters, dtype=float), (len(flat) // max(len(parameters), 1), 1))
    out = np.zeros(len(flat), dtype=np.int64)
    status_of_points(LAWS[name], flat, repeated, 0.0, out)
    return out.reshape(traction.shape[:-1]).astype(np.int8)


# the base of the laws cannot import what is made from them
PointLaw.tractions_of, PointLaw.statuses_of = staticmethod(apply_law), staticmethod(statuses)
