"""Effects at interfaces: contact, friction, gaps, bonds, layers, preload."""

from __future__ import annotations

from collections.abc import Callable

from ..interface.behaviour import bonds
from ..latin.assembly import InterfaceUnit
from .effect import Effect
from .sizes import Sizes


def contact(sizes: Sizes) -> Effect:
    """Interfaces that may open: their normal unknowns and the iteration on them."""
    found = _those(sizes, lambda u: u.behaviour.opens)
    n = sum(2 * u.geometry.n_point for u in found)
    return _interface(
        sizes,
        "unilateral contact",
        found,
        "behaviour",
        n,
        "local stage, normal part",
        f"{sum(u.geometry.n_point for u in found)} points may open",
        "an interface that may open",
        'behaviour = "perfect" (faces that never part)',
    )


def friction(sizes: Sizes) -> Effect:
    """Coulomb friction: the tangential unknowns of contacts."""
    found = _those(sizes, lambda u: u.behaviour.opens and u.behaviour.n_component > 1)
    n = sum(4 * u.geometry.n_point for u in found)
    return _interface(
        sizes,
        "friction",
        found,
        "friction_coefficient",
        n,
        "local stage, cone projection",
        "tangential unknowns where mu > 0, or where nothing slips",
        "friction_coefficient > 0",
        "friction_coefficient = 0",
    )


def gap(sizes: Sizes) -> Effect:
    """Contacts that are open at the start."""
    found = _those(sizes, lambda u: u.behaviour.opens and bool((u.geometry.gap > 0).any()))
    reason = f"open at the start, up to {max((float(u.geometry.gap.max()) for u in found), default=0.0):.4g} m"
    why = tuple(f"interface.{u.name}.gap" for u in found)
    if not found:
        return Effect(
            "initial gap", False, ("interface.*.gap",), "every contact touches at the start", "gap > 0, or meshes apart"
        )
    return Effect("initial gap", True, why, reason, "gap = 0")


def bond(sizes: Sizes) -> Effect:
    """Perfect connections."""
    found = _those(sizes, lambda u: bonds(u.behaviour))
    n = sum(6 * u.geometry.n_point for u in found)
    return _interface(
        sizes,
        "perfect bond",
        found,
        "behaviour",
        n,
        "local stage, bonds",
        "faces with one velocity",
        'behaviour = "perfect"',
        "one mesh for both bodies",
    )


def layers(sizes: Sizes) -> Effect:
    """Elastic layers, soft contacts and viscous joints."""
    found = _those(sizes, lambda u: u.behaviour.compliant)
    n = sum(2 * u.geometry.n_point * u.behaviour.n_component for u in found if not u.behaviour.opens)
    return _interface(
        sizes,
        "layers and joints",
        found,
        "behaviour",
        n,
        "local stage, layers",
        "tractions that follow the jump of displacement or velocity",
        'behaviour = "elastic_layer", ...',
        'behaviour = "perfect"',
    )


def preload(sizes: Sizes) -> Effect:
    """Pressure at the start."""
    found = _those(sizes, lambda u: u.preload > 0)
    if not found:
        return Effect(
            "preload",
            False,
            ("interface.*.preload",),
            "no interface is pressed at the start",
            "preload, preload_force or interference > 0",
        )
    scene = sizes.scene.interface
    keys = tuple(
        f"interface.{u.name}.{key}"
        for u in found
        for key in ("preload", "preload_force", "interference")
        if getattr(scene[u.name], key) > 0
    )
    return Effect(
        "preload",
        True,
        keys,
        f"up to {max(u.preload for u in found):.4g} Pa at the start",
        "set it to 0",
        kernels=("forcing",),
    )


def _those(sizes: Sizes, which: Callable[[InterfaceUnit], bool]) -> list[InterfaceUnit]:
    return [u for u in sizes.discretised.units if which(u)]


def _interface(
    sizes: Sizes, name: str, found: list[InterfaceUnit], key: str, n: int, kernel: str, reason: str, on: str, off: str
) -> Effect:
    """An effect that adds ``n`` interface unknowns: its share of the iteration goes with them."""
    if not found:
        return Effect(name, False, (f"interface.*.{key}",), "no interface asks for it", on)
    share = 1 - (1 - n / max(sizes.n_flat, 1)) ** 2
    return Effect(
        name,
        True,
        tuple(f"interface.{u.name}.{key}" for u in found),
        reason,
        off,
        unknowns=n,
        kernels=(kernel,),
        memory=int(8 * n * (2 * sizes.n_instant + 30) + sum(24 * c.size.channels**2 for c in sizes.classes) * share),
        cost=_cost(sizes, found, n),
    )


def _cost(sizes: Sizes, found: list[InterfaceUnit], n: int) -> float:
    """What ``n`` unknowns of these interfaces add to an instant, s: of a contact with friction, the tangential ones
    what friction costs, the normal ones the rest."""
    if not n:
        return 0.0
    everything = sum(2 * u.geometry.n_point * u.behaviour.n_component for u in found)
    whole = sizes.saved(sizes.without(found))
    if n == everything:
        return whole
    friction = sizes.saved(sizes.without_friction([u for u in found if u.behaviour.n_component > 1]))
    tangential = sum(2 * u.geometry.n_point * (u.behaviour.n_component - 1) for u in found)
    return friction if n == tangential else max(0.0, whole - friction)
