"""Search directions k of (12), (13), (16), (17): per side, normal and tangential, at every point.

The choice changes the number of iterations, never the converged answer. Candidates:

impedance   rho c_p and rho c_s of the side's own material: exact where the step resolves the wave
uniform     the same numbers everywhere (the paper's k = G T_c / L_c is rho c_s for T_c = L_c / c_s)
diagonal    1 / D_ii of the discrete admittance of one instant
row         resistance of the face to a uniform velocity, spread by area
static      without inertia only: 1.5 x the geometric mean of the stiffness of a body as a whole and at one point
automatic   the static one without inertia; diagonal for windows of one instant; for longer windows the impedance
            where the step resolves the wave on both sides (row k over impedance within 0.3 ... 3), else half the row
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..propagator.interface_matrices import resistance
from ..propagator.static import StaticPropagator
from .assembly import Assembly
from .layout import Array

_STATIC = 1.5
RESOLVED = (0.3, 3.0)
WARNED = (0.2, 5.0)


@dataclass(frozen=True)
class SearchDirection:
    """What the scene asks for: ``kind`` of the module docstring, ``factor`` multiplying k, and for "uniform" the
    normal and tangential values, Pa s m-1."""

    kind: str = "automatic"
    factor: float = 1.0
    normal: float = 0.0
    tangential: float = 0.0


def channel_k(assembly: Assembly, wanted: SearchDirection, window: int) -> tuple[Array, str]:
    """k of every channel (n_flat,), Pa s m-1 (0 where a side is rigid), and a word on the choice made."""
    kind = wanted.kind
    if kind == "automatic" and assembly.quasi_static:
        kind = "static"
    if kind == "automatic":
        kind = "diagonal" if window == 1 else "resolved"
    if kind == "impedance":
        k, choice = assembly.impedance.copy(), "impedance"
    elif kind == "uniform":
        k = np.where(assembly.layout.normal, wanted.normal, wanted.tangential)
        choice = "uniform"
    elif kind == "diagonal":
        k, choice = _diagonal(assembly), "diagonal"
    elif kind == "static":
        k, choice = _static(assembly), "stiffness"
    elif kind == "row":
        k, choice = _row(assembly), "row"
    else:
        k, choice = _resolved(assembly)
    k = wanted.factor * k
    k[assembly.rigid] = 0.0
    return k, choice


def inertial_impedance(assembly: Assembly) -> None:
    """Give the sides without a material impedance (rigid bodies) the resistance of their faces within one step."""
    row = _row(assembly)
    missing = assembly.impedance <= 0
    assembly.impedance[missing] = row[missing]


def unresolved_sides(assembly: Assembly) -> list[str]:
    """Sentences on sides whose wave front the mesh and step do not resolve (converged is not accurate there)."""
    row = _row(assembly, normal_only=True)
    remarks = []
    for i, unit in enumerate(assembly.interfaces):
        for side in (0, 1):
            channels = assembly.layout.channels(i, side)[:, 0]
            impedance = assembly.impedance[channels]
            if not impedance.any() or not row[channels].any():
                continue
            ratio = float(np.median(row[channels] / impedance))
            if not WARNED[0] <= ratio <= WARNED[1]:
                coarse = ratio > WARNED[1]
                remarks.append(
                    f"interface {unit.name}, side {unit.sides[side]}: "
                    + ("the mesh is too coarse for this step" if coarse else "the step is too long for this mesh")
                    + f" to follow the wave (resistance of the face over rho c = {ratio:.2g}, followed within "
                    f"{WARNED[0]} ... {WARNED[1]}); a contact shorter than the passage through a few elements is "
                    "not resolved: "
                    + ("refine the mesh there (a smaller step alone does not help)" if coarse else "take smaller steps")
                )
    return remarks


def _diagonal(assembly: Assembly) -> Array:
    """1 / D_ii; one tangential value per point (the largest admittance of its two directions)."""
    admittance = assembly.gather(
        [
            _without_round_off(p.operators.compliance.diagonal() * p.operators.area)[:, None]
            for p in assembly.propagators
        ]
    )
    return _inverse(_one_tangent(assembly, admittance))


def _static(assembly: Assembly) -> Array:
    """1.5 sqrt(k_0 S_ii) over an increment: k_0 the stiffness of the body as a whole (soft, for loads that cross it),
    S_ii that of one point among others held (stiff, for what stays near the face); one tangential value."""
    stiffness = np.zeros(assembly.layout.n_flat)
    for propagator, channels in zip(assembly.propagators, assembly.channels, strict=True):
        assert isinstance(propagator, StaticPropagator)
        own = _without_round_off(propagator.operators.diagonal)
        stiffness[channels] = (_STATIC * np.sqrt(propagator.operators.springs * own))[:, None]
    return assembly.dt * _one_tangent(assembly, stiffness)


def _without_round_off(values: Array) -> Array:
    """Entries that are round-off of the largest of their substructure (held directions) become 0."""
    return np.where(values > 1e-12 * values.max(initial=0.0), values, 0.0)


def _one_tangent(assembly: Assembly, values: Array) -> Array:
    for group in assembly.layout.groups:
        if group.n_component > 1:
            block = group.block(values)
            block[..., 1:] = block[..., 1:].max(axis=-1, keepdims=True)
    return values


def _row(assembly: Assembly, normal_only: bool = False) -> Array:
    """Total force for a unit uniform velocity of the face, over its area; ``normal_only``: 0 in the tangents."""
    layout, propagators = assembly.layout, assembly.propagators
    k, row_of = np.zeros(layout.n_flat), np.full(layout.n_flat, -1)
    class_of = np.full(layout.n_flat, -1)
    for c, channels in enumerate(assembly.channels):
        row_of[channels], class_of[channels] = np.arange(len(channels))[:, None], c
    known: dict[tuple[int, bytes], float] = {}  # members of a class share what they have in common
    for i in range(len(assembly.interfaces)):
        for side in (0, 1):
            flat = layout.channels(i, side)
            c = int(class_of[flat[0, 0]])
            if c < 0:
                continue
            operators, rows = propagators[c].operators, row_of[flat]
            area = operators.area[rows[:, 0]].sum()
            for component in range(1 if normal_only else flat.shape[1]):
                own = rows[:, component]
                key = (c, own.tobytes())
                if key not in known:
                    known[key] = resistance(operators.compliance, own) / area
                k[flat[:, component]] = known[key]
    return k if normal_only else _one_tangent(assembly, k)


def _resolved(assembly: Assembly) -> tuple[Array, str]:
    """Impedance where both sides of an interface are resolved, else half the row value."""
    row, impedance = _row(assembly), assembly.impedance
    k = impedance.copy()
    choices = []
    for i in range(len(assembly.interfaces)):
        sides = [assembly.layout.channels(i, side) for side in (0, 1)]
        resolved = True
        for channels in sides:
            normal = channels[:, 0]
            if impedance[normal].any() and row[normal].any():
                ratio = _median(row[normal] / impedance[normal])
                resolved &= RESOLVED[0] <= ratio <= RESOLVED[1]
        if not resolved:
            for channels in sides:
                k[channels] = 0.5 * row[channels]
        choices.append("impedance" if resolved else "half row")
    return k, ", ".join(sorted(set(choices)))


def _inverse(values: Array) -> Array:
    """1/x where x > 0, else 0."""
    return np.divide(1.0, values, out=np.zeros_like(values), where=values > 0)


def _median(values: Array) -> float:
    """Median of a few numbers (that of NumPy takes ten times as long)."""
    ordered = np.sort(values)
    half = len(ordered) // 2
    return float(0.5 * (ordered[half] + ordered[-half - 1]))
