"""What the penalty of a deck costs: its scene without the layers that stand for it, and how far results are apart."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any, Final

import numpy as np

from ..results.solution import Solution
from .print_cards import DeckPrints
from .printed import printed_blocks

_RIGID: Final[Mapping[str, str]] = {"soft_contact": "contact", "elastic_layer": "perfect"}
_LAYER: Final = ("normal_stiffness", "tangential_stiffness")


def without_penalty(tables: Mapping[str, Any]) -> dict[str, Any] | None:
    """The tables of a scene with contact in the place of layers with a stiffness, bonds in that of tied ones.

    None where it has none of them.
    """
    interfaces = tables.get("interface", {})
    if not any(table.get("behaviour") in _RIGID for table in interfaces.values()):
        return None
    rigid = {}
    for name, table in interfaces.items():
        kind = _RIGID.get(table.get("behaviour"))
        rigid[name] = table
        if kind is not None:
            rigid[name] = {key: value for key, value in table.items() if key not in _LAYER} | {"behaviour": kind}
    return {**tables, "interface": rigid}


def penalty_error(prints: DeckPrints, soft: Solution, exact: Solution) -> Iterator[str]:
    """A line for the force of each interface, and for each quantity that the deck prints: largest difference over the
    largest value, at all instants."""
    for name, history in soft.interfaces.items():
        yield _line(f"force of {name}", [history.force()], [exact.interfaces[name].force()])
    blocks: dict[str, tuple[list[Any], list[Any]]] = {}
    for one, other in zip(printed_blocks(prints, soft), printed_blocks(prints, exact), strict=True):
        if one.kind != "CF":
            both = blocks.setdefault(f"{one.kind} of {one.target}", ([], []))
            both[0].append(one.values)
            both[1].append(other.values)
    for name, (values, others) in blocks.items():
        yield _line(name, values, others)


def _line(name: str, soft: list[Any], exact: list[Any]) -> str:
    largest = max(float(np.abs(values).max()) for values in exact)
    apart = max(float(np.abs(a - b).max()) for a, b in zip(soft, exact, strict=True))
    if largest == 0.0:
        return f"  {name}: none without the penalty, {apart:.3g} with it"
    return f"  {name}: {100.0 * apart / largest:.3g} % of its largest value, {largest:.4g}"
