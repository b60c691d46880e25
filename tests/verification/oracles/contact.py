"""Unilateral contact with Coulomb friction at one instant, all points coupled, to round-off.

Unknown: the forces r (m, 3) on side E' (opposite on E) in the local axes (N, t1, t2) of each point, N from
E to E'. The opening velocity is v = free + G r, with G the Delassus operator. Law at the end of the step:

    0 <= bias + v_N  perpendicular to  r_N >= 0        bias = gap at the start of the step / dt
    |r_T| <= mu r_N,  v_T = -lambda r_T, lambda >= 0, and lambda = 0 inside the cone

Semi-smooth Newton on the projections, on the whole system; block Gauss-Seidel with an exact solution per
point when Newton does not settle. Neither resembles alternating search directions. The result is unique
for small friction; with strong coupling and friction the problem itself may have several.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq

Array = NDArray[np.float64]


@dataclass(frozen=True)
class ContactProblem:
    """One instant: ``operator`` (3 m, 3 m), ``free`` (m, 3), ``bias`` (m,), friction coefficients (m,)."""

    operator: Array
    free: Array
    bias: Array
    friction: Array

    def velocity(self, force: Array) -> Array:
        """Opening velocity under the forces."""
        moved: Array = self.operator @ force.ravel()
        return self.free + moved.reshape(-1, 3)

    def scaling(self) -> Array:
        """Per point, the positive factor that turns a velocity into a force."""
        compliance: Array = np.diag(self.operator).reshape(-1, 3).mean(axis=1)
        rho: Array = np.reciprocal(compliance)
        return rho

    def residual(self, force: Array) -> Array:
        """Force minus its projection (m, 3): zero exactly at a solution, in units of force."""
        rho, v = self.scaling(), self.velocity(force)
        trial = force - rho[:, None] * v
        trial[:, 0] -= rho * self.bias
        normal = np.maximum(trial[:, 0], 0.0)
        size = np.linalg.norm(trial[:, 1:], axis=1)
        bound = self.friction * normal
        factor = np.where(size > bound, bound / np.where(size > 0.0, size, 1.0), 1.0)
        projected: Array = np.column_stack([normal, factor[:, None] * trial[:, 1:]])
        return np.asarray(force - projected, float)


def solve(problem: ContactProblem, guess: Array | None = None, tolerance: float = 1e-12) -> Array:
    """Forces (m, 3). Raises ArithmeticError when the residual stays above ``tolerance`` x the force scale."""
    force = np.zeros_like(problem.free) if guess is None else guess.copy()
    aim = tolerance * force_scale(problem)
    force = newton(problem, force, aim)
    for _ in range(40):
        if np.abs(problem.residual(force)).max(initial=0.0) <= aim:
            return force
        force = newton(problem, gauss_seidel(problem, force, aim, sweeps=50), aim)
    raise ArithmeticError(f"contact not solved: residual {np.abs(problem.residual(force)).max():.3e}, aim {aim:.3e}")


def force_scale(problem: ContactProblem) -> float:
    """Size of the forces at stake: what would stop the free motion."""
    rho = problem.scaling()
    motion = np.abs(problem.free).max(axis=1, initial=0.0) + np.abs(np.minimum(problem.bias + problem.free[:, 0], 0.0))
    return float((rho * motion).max(initial=0.0)) or 1.0


def newton(problem: ContactProblem, force: Array, aim: float, iterations: int = 60) -> Array:
    """Semi-smooth Newton (Alart, Curnier 1991) with step halving; returns the best iterate met."""
    best, smallest = force, float(np.abs(problem.residual(force)).max(initial=0.0))
    for _ in range(iterations):
        if smallest <= aim:
            break
        step = _newton_step(problem, best)
        for halving in range(12):
            trial = best + 0.5**halving * step
            size = float(np.abs(problem.residual(trial)).max())
            if size < smallest:
                best, smallest = trial, size
                break
        else:
            break
    return best


def _newton_step(problem: ContactProblem, force: Array) -> Array:
    matrix, residual = jacobian(problem, force), problem.residual(force).ravel()
    try:
        step = np.linalg.solve(matrix, -residual)
    except np.linalg.LinAlgError:
        step = np.linalg.lstsq(matrix, -residual, rcond=1e-14)[0]
    return step.reshape(-1, 3).astype(float)


def jacobian(problem: ContactProblem, force: Array) -> Array:
    """Generalised derivative of ``residual``."""
    m, rho = len(force), problem.scaling()
    scale = np.repeat(rho, 3)[:, None]
    of_trial = np.eye(3 * m) - scale * problem.operator  # derivative of the trial forces
    trial = force - rho[:, None] * problem.velocity(force)
    trial[:, 0] -= rho * problem.bias
    out = np.eye(3 * m)
    for i in range(m):
        n, t = 3 * i, slice(3 * i + 1, 3 * i + 3)
        if trial[i, 0] <= 0.0:
            continue
        out[n] -= of_trial[n]
        size, bound = float(np.linalg.norm(trial[i, 1:])), problem.friction[i] * trial[i, 0]
        if size <= bound:
            out[t] -= of_trial[t]
        elif size > 0.0:
            e = trial[i, 1:] / size
            out[t] -= problem.friction[i] * np.outer(e, of_trial[n])
            out[t] -= bound / size * (np.eye(2) - np.outer(e, e)) @ of_trial[t]
    return out


def gauss_seidel(problem: ContactProblem, force: Array, aim: float, sweeps: int = 1000) -> Array:
    """Block Gauss-Seidel: each point in turn solved exactly with the others held."""
    force = force.copy()
    for _ in range(sweeps):
        for i in range(len(force)):
            rows = slice(3 * i, 3 * i + 3)
            block = problem.operator[rows, rows]
            others = problem.free[i] + problem.operator[rows] @ force.ravel() - block @ force[i]
            others[0] += problem.bias[i]
            force[i] = one_point(block, others, float(problem.friction[i]))
        if np.abs(problem.residual(force)).max(initial=0.0) <= aim:
            break
    return force


def one_point(block: Array, free: Array, friction: float) -> Array:
    """Exact force of one point: open, stuck, or sliding in a direction found by bracketing."""
    if free[0] >= 0.0:
        return np.zeros(3)
    stuck: Array = np.linalg.solve(block, -free).astype(float)
    if stuck[0] >= 0.0 and np.hypot(stuck[1], stuck[2]) <= friction * stuck[0]:
        return stuck

    def sliding(angle: float) -> Array:
        cone = np.array([1.0, friction * np.cos(angle), friction * np.sin(angle)])
        return cone * float(-free[0] / (block[0] @ cone))

    def across(angle: float) -> float:
        v = free + block @ sliding(angle)
        return float(v[1] * np.sin(angle) - v[2] * np.cos(angle))

    angles = np.linspace(0.0, 2.0 * np.pi, 73)
    values = [across(a) for a in angles]
    for a, b, x, y in zip(angles[:-1], angles[1:], values[:-1], values[1:], strict=True):
        if x == 0.0 or x * y < 0.0:
            angle = a if x == 0.0 else brentq(across, a, b, xtol=1e-15, rtol=1e-14)
            force = sliding(angle)
            v = free + block @ force
            if force[0] >= 0.0 and v[1] * np.cos(angle) + v[2] * np.sin(angle) <= 0.0:
                return force
    raise ArithmeticError("no sliding direction found at a contact point")
