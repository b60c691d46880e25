"""Units of a deck, which names none: those that are given, or those in which its modulus and density are of a solid.

Solids have moduli from 0.5 to 1200 GPa and densities from 400 to 23,000 kg/m3. Densities tell the system, and all
moduli have to agree with it. Without any density a modulus tells it where it is that of a metal, wood or glass, from
9 GPa on: a polymer in psi has the number of a metal in MPa.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Final, Literal

from ..errors import InputError
from ..scene.units import UNIT_SYSTEMS, SystemName, UnitSystem

UnitsOption = Literal["mm-t-s", "m", "in", "none"]
"""What ``--units`` may be."""
SYSTEMS: Final[Mapping[UnitsOption, SystemName]] = {
    "mm-t-s": "mm-t-s-MPa",
    "m": "SI",
    "in": "in-lbf-s-psi",
    "none": "none",
}
"""System of the scene by option."""
WORDS: Final[Mapping[str, str]] = {
    "mm-t-s-MPa": "mm, t, s, MPa",
    "SI": "m, kg, s, Pa",
    "in-lbf-s-psi": "in, lbf, s, psi",
    "none": "none",
}
"""Systems in words."""
_MODULI: Final = 0.5e9, 1.2e12  # Pa: polymers to diamond
_STIFF: Final = 9e9  # Pa: 1.3e6 psi, above the modulus of diamond in MPa
_DENSITIES: Final = 400.0, 23e3  # kg m-3: wood to iridium
_SIGNS: Final = (("modulus", "young_modulus", "Pa", _MODULI), ("density", "density", "kg m-3", _DENSITIES))


def units_of(given: UnitsOption | None, materials: Mapping[str, Mapping[str, float]], where: str) -> tuple[str, str]:
    """System of units of a deck, and the sentence that says where it comes from.

    Parameters
    ----------
    given : by the user; None: guessed. materials : constants by name of the material. where : name of the deck.

    Raises
    ------
    InputError : there is no modulus and no density, they tell nothing, or they contradict each other.

    Examples
    --------
    >>> units_of(None, {"steel": {"young_modulus": 210e3, "density": 7.8e-9}}, "deck.inp")
    ('mm-t-s-MPa', 'Units mm, t, s, MPa: guessed from the modulus 210000 and the density 7.8e-09 of steel')
    """
    if given is not None:
        return SYSTEMS[given], f"Units {WORDS[SYSTEMS[given]]}: given by --units {given}"
    fitting = [name for name in WORDS if UNIT_SYSTEMS[name].measurable and _fits(UNIT_SYSTEMS[name], materials)]
    numbers = [
        f"the {word} {constants[key]:g} of {name}"
        for name, constants in materials.items()
        for word, key, _, _ in _SIGNS
        if key in constants
    ]
    if len(fitting) == 1 and numbers:
        return fitting[0], f"Units {WORDS[fitting[0]]}: guessed from {_joined(numbers)}"
    if numbers:
        what = "a deck names no units, and its materials are of a solid in none of the systems, or not all in the same"
    else:
        what = "a deck names no units, and without *ELASTIC and *DENSITY they cannot be guessed"
    remedy = "give them, e.g. --units mm-t-s (mm, t, s, MPa; the density of steel is 7.85e-9)"
    raise InputError.of(
        "the units are not known", where, what, "; ".join(numbers[:6]) or None, "--units mm-t-s, m, in or none", remedy
    )


def _fits(system: UnitSystem, materials: Mapping[str, Mapping[str, float]]) -> bool:
    """Whether all moduli and densities are of solids in a system, and one of them tells it."""
    moduli = [constants["young_modulus"] for constants in materials.values() if "young_modulus" in constants]
    telling = any("density" in constants for constants in materials.values())
    telling = telling or any(modulus * system.size("Pa") >= _STIFF for modulus in moduli)
    return telling and all(
        low <= constants[key] * system.size(unit) <= high
        for constants in materials.values()
        for _, key, unit, (low, high) in _SIGNS
        if key in constants
    )


def _joined(numbers: Iterable[str]) -> str:
    """Numbers of materials in one sentence; those of one material together."""
    by_name: dict[str, list[str]] = {}
    for text in numbers:
        number, _, name = text.rpartition(" of ")
        by_name.setdefault(name, []).append(number)
    return ", ".join(f"{' and '.join(values)} of {name}" for name, values in by_name.items())
