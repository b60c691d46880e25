"""The one-dimensional verification problems with their exact solutions (SI units, per unit area)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from .bars import Bar, Waves
from .connections import Absorbing, Connection, Contact, Friction, Joint, PrescribedStress
from .piecewise import PiecewiseLinear


@dataclass(frozen=True)
class Solved:
    """A solved problem: its waves and the contact (or frictional) connection, counted from the left."""

    waves: Waves
    contact: int
    initial_gap: float = 0.0

    @property
    def pressure(self) -> PiecewiseLinear:
        """Contact pressure, positive in compression."""
        return self.waves.stress[self.contact].scaled(-1.0)

    def gap(self, time: float) -> float:
        """Opening at ``time``."""
        return self.waves.gap(self.contact, self.initial_gap, time)


def _free(end: float) -> PrescribedStress:
    return PrescribedStress(PiecewiseLinear.constant(0.0, 0.0, end))


def _law(connection: Connection) -> Contact:
    if not isinstance(connection, Contact):
        raise TypeError(f"not a contact: {connection!r}")
    return connection


def beam_in_traction(
    length: float = 0.5, modulus: float = 210e9, density: float = 7800.0, pressure: float = 100e6, end: float = 250 / 42
) -> Solved:
    """Two bars (2 L and L), gap 0.3 x 2 p/(rho c) x L/c, rectangular pulse of duration L/c on the first.

    Bar 1 is two substructures joined perfectly, so three bars here; ``end`` in units of L/c.
    """
    one = Bar(length, modulus, density)
    transit = one.transit
    gap = 0.3 * 2.0 * pressure / one.impedance * transit
    pulse = PiecewiseLinear.from_pieces(0.0, [(transit, -pressure, -pressure), (end * transit, 0.0, 0.0)])
    rows: list[Connection] = [PrescribedStress(pulse), Joint(), Contact(gap), _free(end * transit)]
    return Solved(Waves([one, one, one], rows, end * transit), 2, gap)


def two_bars_on_a_wall(
    length: float = 0.1,
    modulus: float = 210e9,
    density: float = 7800.0,
    pressure: float = 100e6,
    gap: float = 1e-5,
    end: float = 100e-6,
) -> Solved:
    """Two equal bars, the first under a constant pressure from t = 0, the second against a wall."""
    one = Bar(length, modulus, density)
    step = PrescribedStress(PiecewiseLinear.constant(-pressure, 0.0, end))
    return Solved(Waves([one, one], [step, Contact(gap), Joint()], end), 1, gap)


def colliding_bars(first: Bar, second: Bar, gap: float, end: float) -> Solved:
    """Two free bars that fly towards each other."""
    return Solved(Waves([first, second], [_free(end), Contact(gap), _free(end)], end), 1, gap)


def impact_bar(end: float = 2.0) -> Solved:
    """Bar of length 10, 5 above a rigid wall, thrown at it with speed 10 (Doyen, Ern, Piperno 2011)."""
    bar = Bar(10.0, 900.0, 1.0, velocity=-10.0)
    return Solved(Waves([bar], [Contact(5.0), _free(end)], end), 0, 5.0)


def bouncing_bar(end: float = 16.0 / 3.0) -> Solved:
    """The same bar dropped from rest under gravity 10 (Doyen, Ern, Piperno 2011)."""
    bar = Bar(10.0, 900.0, 1.0, body_force=-10.0)
    return Solved(Waves([bar], [Contact(5.0), _free(end)], end), 0, 5.0)


def shear_interface(
    shear_modulus: float, density: float, length: float, incident: PiecewiseLinear, threshold: float, end: float
) -> Solved:
    """Two equal columns, frictional interface of strength mu sigma0, shear wave sent in from the left end.

    ``incident`` is the stress of the incident wave at the left end; a dashpot rho c_s there needs a traction
    of twice that size. The right end absorbs.
    """
    column = Bar(length, shear_modulus, density)
    still = PiecewiseLinear.constant(0.0, 0.0, end)
    rows: list[Connection] = [Absorbing(incident), Friction(threshold), Absorbing(still)]
    return Solved(Waves([column, column], rows, end), 1)


def piecewise(function: Callable[[float], float], end: float, pieces: int) -> PiecewiseLinear:
    """A smooth function replaced by ``pieces`` chords: what the exact solution can carry."""
    times = [end * i / pieces for i in range(pieces + 1)]
    return PiecewiseLinear.through(times, [function(t) for t in times])


def contact_instants(solved: Solved) -> tuple[list[float], list[float]]:
    """Instants at which the contact closes, and at which it opens."""
    law = _law(solved.waves.connections[solved.contact])
    return law.closings, law.openings
