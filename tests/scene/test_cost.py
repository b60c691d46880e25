"""The cost model: orders the propagators, knows the pattern of a factor, chooses what fits; no more is promised."""

from __future__ import annotations

import time
from typing import Any

import numpy as np
import pytest

import latin_fmu
from latin_fmu import api
from latin_fmu.assembly.build import discretise
from latin_fmu.assembly.cost import fitting, memory_needed
from latin_fmu.assembly.prediction import predict
from latin_fmu.assembly.run_cost import march, run_cost, set_up
from latin_fmu.assembly.run_sizes import run_sizes
from latin_fmu.compiled import COMPILES
from latin_fmu.memory import physical_memory
from latin_fmu.propagator.cost import cost, factor_bytes, size_of
from latin_fmu.propagator.registry import PropagatorSettings
from latin_fmu.propagator.seconds import SECONDS
from latin_fmu.results.summary import summary


def scene(elements: int, **solver: Any) -> latin_fmu.Scene:
    """Two blocks pressed together."""
    box = {"size": [0.01] * 3, "elements": [elements] * 3}
    return latin_fmu.scene_from_dict(
        {
            "name": "blocks",
            "material": {"steel": {"young_modulus": 210e9, "poisson_ratio": 0.3, "density": 7800.0}},
            "substructure": {
                "low": {"material": "steel", "box": {"origin": [0.0, 0.0, 0.0], **box}},
                "high": {"material": "steel", "box": {"origin": [0.0, 0.0, 0.01], **box}},
            },
            "interface": {"i": {"sides": ["low.zmax", "high.zmin"], "friction_coefficient": 0.3}},
            "boundary": {"base": {"type": "fixed", "face": "low.zmin"}},
            "load": {"p": {"face": "high.zmax", "pressure": 1e8, "law": {"type": "half_sine", "duration": 4e-6}}},
            "time": {"end": 4e-6, "instants": 40},
            "solver": {"share_identical": False, **solver},
        }
    )


@pytest.mark.skipif(not COMPILES, reason="the factor of SciPy has another pattern")
def test_the_factor_is_as_large_as_predicted() -> None:
    """Entries from the pattern, to the last one; the law of nested dissection within a factor of two."""
    prepared = discretise(scene(8))
    built = prepared.build()
    for part, propagator in zip(prepared.classes, built.assembly.propagators, strict=True):
        size = size_of(part.members[0], 1)
        factor: Any = propagator.operators
        dense = 16 * size.interface**2 + factor.factor.symbolic.rows.nbytes
        assert 8 * size.factor_entries + dense == factor.factor.nbytes
        assert 0.5 < factor_bytes(size.unknowns) / (8 * size.factor_entries) < 2.0


def test_what_is_larger_costs_more() -> None:
    sizes = [size_of(discretise(scene(n)).classes[0].members[0], 1) for n in (3, 6, 9)]
    for kind in ("direct", "explicit", "reduced", "cg"):
        costs = [cost(kind, size) for size in sizes]
        for name in ("setup", "instant", "memory"):
            values = [getattr(c, name) for c in costs]
            assert values == sorted(values), (kind, name)
    many = cost("direct", sizes[2].__class__(**{**vars(sizes[2]), "members": 8}))
    assert cost("direct", sizes[2]).instant < many.instant < 8 * cost("direct", sizes[2]).instant
    assert cost("direct", sizes[2], precision="float32").memory < cost("direct", sizes[2]).memory


def test_operations_of_an_instant_are_counted() -> None:
    """By hand, for two blocks with friction and factors of their own: both half solves, three sparse products, two
    products with the Schur inverse, one with the condensed operator per iteration and one for the mismatch."""
    prepared = discretise(scene(4))
    sizes = run_sizes(prepared)
    counts, n = march(sizes), prepared.scene.time.n_step
    parts = [size_of(c.members[0], 1) for c in prepared.classes]
    assert len(parts) == 2
    assert counts["sweep"] == n * sum(2 * p.factor_entries for p in parts)
    matrices = [c.members[0].reduced for c in prepared.classes]
    assert counts["sparse"] == n * sum(k.nnz + m.nnz for m, _, k in matrices)
    dense = sum(2 * p.interface**2 + (sizes.iterations + 1) * p.channels**2 for p in parts)
    assert counts["dense"] == pytest.approx(n * dense)
    assert counts["history"] == n * prepared.layout.n_flat
    assert set_up(sizes)["cube"] == sum(p.interface**3 + 3 * p.channels**3 for p in parts)
    found = {name for name, count in counts.items() if count}
    assert not found & {"energy", "field", "stress", "probe_value", "call", "many_sweep"}
    assert set(counts) | set(set_up(sizes)) <= set(SECONDS)
    assert run_cost(sizes).total == pytest.approx(
        sum(SECONDS[k] * v for part in (counts, set_up(sizes)) for k, v in part.items())
    )


def test_what_is_kept_is_counted() -> None:
    tables = scene(4).tables()
    tables["output"] |= {"fields": True, "stress": True, "energy": True, "every": 3}
    prepared = discretise(latin_fmu.scene_from_dict(tables))
    counts, n = march(run_sizes(prepared)), prepared.scene.time.n_step
    stored, bodies = n // 3 + 1, prepared.bodies.values()
    matrices = [c.members[0].reduced for c in prepared.classes]
    assert counts["energy"] == 2 * n
    assert counts["energy_entry"] == n * sum(k.nnz + m.nnz for m, _, k in matrices)
    assert counts["field"] == counts["stress"] == 2 * stored
    assert counts["field_node"] == stored * sum(b.mesh.n_node for b in bodies)
    assert counts["stress_cell"] == stored * sum(b.mesh.n_cell for b in bodies)


def test_a_body_that_nothing_reaches_is_not_counted() -> None:
    tables = scene(4).tables()
    moving = march(run_sizes(discretise(latin_fmu.scene_from_dict(tables))))
    tables["interface"] = {}
    lone = march(run_sizes(discretise(latin_fmu.scene_from_dict(tables))))
    assert 0.4 * moving["vector"] < lone["vector"] < 0.6 * moving["vector"]


def test_predicted_and_real_seconds_are_of_one_size() -> None:
    """A factor of ten on whatever machine the tests run, for direct and explicit marches of 2 x 2200 unknowns."""
    for propagator in ("direct", "explicit"):
        prepared = discretise(scene(8, propagator=propagator))
        prediction = predict(run_sizes(prepared))
        assert prediction.kind == propagator
        api.run(prepared.build())  # kernels
        built = prepared.build()
        start = time.process_time()
        api.run(built)
        real = time.process_time() - start
        assert 0.1 * real < prediction.march < 10 * real, (propagator, prediction.march, real)


def test_explicit_and_reduced_are_suggested_never_chosen() -> None:
    prediction = predict(run_sizes(discretise(scene(14))))
    assert prediction.kind == "direct"
    assert [kind for kind, _, _ in prediction.cheaper()] == ["explicit", "reduced"]
    assert all("another answer" in what and 0 < factor < 0.4 for _, what, factor in prediction.cheaper())
    assert "direct propagator" in prediction.text()


def test_conjugate_gradients_where_factors_do_not_fit() -> None:
    classes = discretise(scene(6)).classes
    direct = PropagatorSettings("direct")
    needed = memory_needed(classes, direct)
    assert fitting(classes, direct, 2 * needed).kind == "direct"
    assert fitting(classes, direct, 1.2 * needed).kind == "cg"  # 70 % of it may be taken
    assert fitting(classes, PropagatorSettings("explicit"), 1.0).kind == "explicit"
    assert physical_memory() >= 0


def test_the_choice_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("latin_fmu.assembly.cost.physical_memory", lambda: 1000)
    automatic, asked = latin_fmu.solve(scene(2)), latin_fmu.solve(scene(2, propagator="direct"))
    assert any("conjugate gradients" in w for w in automatic.warnings)
    assert not any("conjugate gradients" in w for w in asked.warnings)
    force = [s.interfaces["i"].force() for s in (automatic, asked)]
    np.testing.assert_allclose(force[0], force[1], atol=1e-7 * np.abs(force[1]).max())


def test_the_summary_shows_predicted_against_real() -> None:
    solution = latin_fmu.solve(scene(2))
    assert solution.timings.predicted > 0
    assert "predicted" in summary(solution.outcome, "blocks")
