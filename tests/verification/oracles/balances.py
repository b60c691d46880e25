"""Energy and momentum of the exact solution, from its fields and from what acts on it: they must agree.

Per unit area of cross-section.
"""

from __future__ import annotations

from .bars import Waves
from .piecewise import PiecewiseLinear, product_integral


def energy(waves: Waves, time: float) -> float:
    """Kinetic + elastic energy per unit area: integral of (right^2 + left^2)/(4 E) dx."""
    total = 0.0
    for i, b in enumerate(waves.bars):
        for wave, sign in ((waves.rightward[i], -1.0), (waves.leftward[i], 1.0)):
            start = time - b.transit
            ramp = PiecewiseLinear.from_pieces(start, [(time, sign * b.body_force * b.length, 0.0)])
            seen = PiecewiseLinear(start)
            for s, e, y0, y1 in wave.pieces(start, time):
                r0, r1 = ramp.on(s, e)
                seen.append(e, y0 + r0, y1 + r1)
            total += b.speed * product_integral(seen, seen, start, time) / (4.0 * b.modulus)
    return total


def momentum(waves: Waves, time: float) -> float:
    """Momentum per unit area from the fields at ``time``."""
    total = 0.0
    for i, b in enumerate(waves.bars):
        difference = waves.leftward[i].integral(time - b.transit, time)
        difference -= waves.rightward[i].integral(time - b.transit, time)
        total += b.density * b.speed * 0.5 * (difference + b.body_force * b.length * b.transit) / b.impedance
    return total


def impulse(waves: Waves, time: float) -> float:
    """Initial momentum + impulse of the end stresses and body forces: equals ``momentum``."""
    start = sum(b.density * b.length * b.velocity + b.body_force * b.length * time for b in waves.bars)
    return start + waves.stress[-1].integral(0.0, time) - waves.stress[0].integral(0.0, time)


def work(waves: Waves, time: float) -> float:
    """Work per unit area of every connection and body force on the bars since t = 0."""
    total = 0.0
    for j, s in enumerate(waves.stress):
        if j:
            total += product_integral(s, waves.velocity[j][0], 0.0, time)
        if j < len(waves.bars):
            total -= product_integral(s, waves.velocity[j][1], 0.0, time)
    for i, b in enumerate(waves.bars):
        if b.body_force:
            path = b.density * b.length * b.velocity * time + 0.5 * b.body_force * b.length * time**2
            path += waves.stress[i + 1].double_integral(0.0, time) - waves.stress[i].double_integral(0.0, time)
            total += b.body_force / b.density * path
    return total


def dissipation(waves: Waves, connection: int, time: float) -> float:
    """Energy lost in an inner connection (friction) per unit area since t = 0."""
    first, second = waves.velocity[connection]
    s = waves.stress[connection]
    return product_integral(s, second, 0.0, time) - product_integral(s, first, 0.0, time)
