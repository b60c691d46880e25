"""Error indicator (24) and force residual of the kernels against their definitions."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest

from latin_fmu.kernels import entries, iteration
from latin_fmu.kernels.instants import accept
from latin_fmu.latin.run_image import negligible_scales
from latin_fmu.latin.search_direction import Direction
from latin_fmu.latin.settings import SolverSettings
from latin_fmu.march import march as run
from tests.plain_kernels import call

Array = np.ndarray
NOTHING = np.zeros(3)
WINDOW = 6  # instants that the image has room for


@dataclass(frozen=True)
class Measure:
    """``value`` : sqrt(eta) or force residual; ``scales`` (3,) that it leaves."""

    value: float
    scales: Array


class Indicator:
    """The kernels' measures of given fields, for any k."""

    def __init__(self, march: Any, k: Array) -> None:
        self.image, self._k, self._run = march.image, k, march
        direction = Direction(march.assembly, SolverSettings(), 1)
        direction.k, direction.z = k, np.divide(1.0, k, out=np.zeros_like(k), where=k > 0)
        direction.metric = march.assembly.layout.area * direction.z
        direction.bind()
        march._directions[1] = direction
        self.image.bind(9, direction.run_fields(), direction.group_fields(), afresh=True)

    def _put(self, scales: Array, **fields: Array) -> int:
        n = len(next(iter(fields.values())))
        for name, values in fields.items():
            self.image.field(name, n, self.image.n_flat)[:] = values
        self.image.field("scales", 3)[:] = scales
        return n

    def field(self, residual: Array, fields: Any, scales: Array) -> Measure:
        """sqrt(eta) of fields F, W, F_hat, W_hat whose residual is given: q = f_hat + k w_hat - residual."""
        f, w, f_hat, w_hat = fields
        q = f_hat + self._k * w_hat - residual
        n = self._put(scales, q=q, f=f, w=w, local_f=f_hat, local_w=w_hat)
        self.image.set({"tolerance": 1e-300})  # the force residual is not computed
        call(iteration.measure, self.image, n, 0, 0)
        # ground has none: it moves as the law says
        moves = np.setdiff1d(np.arange(self.image.n_flat), self._run.assembly.ground.channels)
        actual, expected = self.image.field("r", n, self.image.n_flat)[:, moves], residual[:, moves]
        assert actual == pytest.approx(expected, rel=1e-9, abs=1e-9 * (np.abs(f_hat).max() + 1e-300))
        measure = self.image.field("measure", 8)
        if measure[0] > 0.0:  # else it is within the tolerance, and the forces are looked at
            np.testing.assert_array_equal(measure[3:5], scales[1:])
        return Measure(float(measure[0]), np.array([measure[2], *scales[1:]]))

    def force_residual(self, residual: Array, f_hat: Array, scales: Array) -> Measure:
        """Force residual."""
        n = self._put(scales, r=residual, local_f=f_hat)
        measure = self.image.field("measure", 8)
        measure[0], measure[2:5] = 1.0, scales  # sqrt(eta) is not that of a joint at rest
        self.image.call(entries.FORCES, n)
        return Measure(float(measure[1]), measure[2:5].copy())

    def per_interface(self, residual: Array, scales: Array) -> Array:
        """Largest indicator of each interface."""
        n = self._put(scales, r=residual)
        self.image.field("measure", 8)[2:5] = scales
        worst = self.image.field("worst", len(self._run.assembly.interfaces))
        worst[:] = 0.0
        call(accept, self.image, n)
        np.testing.assert_array_equal(self.image.field("scales", 3), scales)
        return worst.copy()

    def floor(self) -> Array:
        """Scales of negligible fields."""
        scales: Array = negligible_scales(self._run.image, self._run.direction(1), 1e-3)
        return scales


@pytest.fixture
def march(blocks_scene: Any, made: Any, begun: Any) -> Any:
    """Two materials, friction, ground; at t = 0."""
    return begun(made(blocks_scene(solver={"window": WINDOW})))


@pytest.fixture
def assembly(march: Any) -> Any:
    """Of the same."""
    return march.assembly


def measured(indicator: Indicator, residual: Any, fields: Any, scales: Array) -> Measure:
    """See ``Indicator.field``."""
    return indicator.field(residual, fields, scales)


def fields(assembly: Any, k: Array, n: int = 3) -> tuple[Array, ...]:
    """F, W, F_hat, W_hat that satisfy E+ for k, and the residual of q; ground: given motion, hat tractions only."""
    rng = np.random.default_rng(8)
    size = assembly.layout.n_flat
    f, w, f_hat = rng.normal(size=(3, n, size))
    w_hat = w + np.divide(f_hat - f, k, out=np.zeros_like(f), where=k > 0)
    residual = (f_hat + k * w_hat) - (f + k * w)
    return f, w, f_hat, w_hat, residual


def eta(assembly: Any, f: Array, w: Array, f_hat: Array, w_hat: Array) -> float:
    """(24) from its definition, sides that can move only; the fields are the tractions and the velocities relative to
    the common motion W_c = (Z W + Z' W') / (Z + Z') of both sides, that of the ground where one is held."""
    z = assembly.impedance
    moves = z > 0
    area = assembly.layout.area

    def square(traction: Array, velocity: Array) -> float:
        part = area * (np.divide(traction**2, z, out=np.zeros_like(traction), where=moves) + z * velocity**2)
        return float(part[:, moves].sum())

    def relative(velocity: Array) -> Array:
        rest = velocity.copy()
        for group in assembly.layout.groups:
            own, block = group.block(z), np.moveaxis(np.array([group.block(row) for row in velocity]), 1, 0)
            for n, values in enumerate(block.swapaxes(0, 1)):
                weights = np.where((own > 0).all(axis=0), own, own == 0)  # the ground weighs all
                common = (weights * values).sum(axis=0) / weights.sum(axis=0)
                group.block(rest[n])[:] = values - common
        return rest

    return square(f - f_hat, w - w_hat) / (square(f, relative(w)) + square(f_hat, relative(w_hat)))


@pytest.mark.parametrize("level", [0.01, 1.0, 30.0])
def test_indicator_is_its_definition_whatever_k(march: Any, assembly: Any, level: float) -> None:
    k = level * np.where(assembly.impedance > 0, 1.0 + np.arange(assembly.layout.n_flat) % 5, 0.0)
    f, w, f_hat, w_hat, residual = fields(assembly, k)
    measure = measured(Indicator(march, k), residual, (f, w, f_hat, w_hat), NOTHING)
    assert measure.value == pytest.approx(np.sqrt(eta(assembly, f, w, f_hat, w_hat)), rel=1e-12)


def test_indicator_is_zero_at_the_fixed_point_and_never_nan(march: Any, assembly: Any) -> None:
    k = np.where(assembly.impedance > 0, 2.0, 0.0)
    indicator = Indicator(march, k)
    f, w, _, _, _ = fields(assembly, k)
    nothing = np.zeros_like(f)
    assert measured(indicator, nothing, (f, w, f, w), indicator.floor()).value == 0.0
    assert measured(indicator, nothing, (nothing,) * 4, indicator.floor()).value == 0.0  # quiet: no 0 / 0
    assert indicator.force_residual(nothing, nothing, indicator.floor()).value == 0.0
    assert not indicator.per_interface(nothing, indicator.floor()).any()


def test_scale_is_the_largest_met(march: Any, assembly: Any) -> None:
    """A small window after a large one is measured against the large one, whatever its length."""
    k = np.where(assembly.impedance > 0, 2.0, 0.0)
    indicator = Indicator(march, k)
    *large, residual = fields(assembly, k, 3)
    first = measured(indicator, residual, tuple(large), NOTHING)
    small = tuple(1e-3 * x[:1] for x in large)
    second = measured(indicator, 1e-3 * residual[:1], small, first.scales)
    assert second.scales[0] == first.scales[0]
    alone = measured(indicator, 1e-3 * residual[:1], small, NOTHING)
    assert second.value == pytest.approx(
        1e-3 * alone.value * np.sqrt(alone.scales[0] * 1e6 / first.scales[0]), rel=1e-9
    )
    doubled = tuple(np.concatenate([x, x]) for x in large)
    twice = measured(indicator, np.concatenate([residual, residual]), doubled, NOTHING)
    assert twice.value == pytest.approx(first.value, rel=1e-12)
    assert twice.scales[0] == pytest.approx(first.scales[0], rel=1e-12)


def test_parts_of_the_interfaces_add_up(march: Any, assembly: Any) -> None:
    k = np.where(assembly.impedance > 0, 3.0, 0.0)
    indicator = Indicator(march, k)
    *all_fields, residual = fields(assembly, k)
    whole = measured(indicator, residual, tuple(all_fields), NOTHING)
    parts = indicator.per_interface(residual, whole.scales)
    assert parts.shape == (2,)
    assert np.sqrt((parts**2).sum()) == pytest.approx(whole.value, rel=1e-12)


def test_force_residual_is_its_definition(march: Any, assembly: Any) -> None:
    """max over instants of sqrt(f . C f), f = area (F - F_hat), normal and tangential parts each to its scale."""
    k = np.where(assembly.impedance > 0, 2.0, 0.0)
    f, _, f_hat, _, residual = fields(assembly, k)
    area, normal = assembly.layout.area, assembly.layout.normal

    def norm(nodal: Array) -> float:
        total = 0.0
        for p, channels in zip(assembly.propagators, assembly.channels, strict=True):
            for j in range(channels.shape[1]):
                total += nodal[channels[:, j]] @ p.operators.compliance @ nodal[channels[:, j]]
        return float(np.sqrt(total))

    expected = max(
        max(norm(mask * area * (f[i] - f_hat[i])) for i in range(3))
        / max(norm(mask * area * f_hat[i]) for i in range(3))
        for mask in (normal, ~normal)
    )
    measure = Indicator(march, k).force_residual(residual, f_hat, NOTHING)
    assert measure.value == pytest.approx(expected, rel=1e-12)


def test_shear_error_is_seen_beside_a_large_pressure(march: Any, assembly: Any) -> None:
    """A tangential force residual as large as the shear itself is 1, however large the normal forces are."""
    k = np.where(assembly.impedance > 0, 2.0, 0.0)
    tangential = ~assembly.layout.normal
    f_hat = np.where(tangential, 0.05, 1.0)[None] * np.ones((1, assembly.layout.n_flat))
    residual = np.where(tangential & (k > 0), 2 * 0.05, 0.0)[None]
    value = Indicator(march, k).force_residual(residual, f_hat, NOTHING).value
    assert 0.5 < value <= 1.0 + 1e-12


@pytest.mark.parametrize("factor", [0.3, 4.0])
def test_runs_stop_at_the_same_distance_from_the_answer_for_any_k(blocks_scene: Any, made: Any, factor: float) -> None:
    """No choice of k changes the measure of convergence: the certified error bounds the true one alike."""
    answer = run(made(blocks_scene(solver={"tolerance": 1e-9, "force_tolerance": 1e-8}))).outcome
    direction = {"type": "impedance", "factor": factor}
    rough = run(made(blocks_scene(solver={"tolerance": 1e-3, "search_direction": direction}))).outcome
    assert rough.converged
    assert answer.converged
    exact = answer.interfaces["rub"].force()
    error = np.abs(rough.interfaces["rub"].force() - exact).max() / np.abs(exact).max()
    assert error < 0.02
