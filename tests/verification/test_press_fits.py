"""Clearances and press fits of round and plane faces: pressure against Lame, what the number and the meshes say.

A pin of radius R and a hub to r_o in plane stress, of one material: with the interference d the pressure is

    p = d E / (R [(r_o^2 + R^2) / (r_o^2 - R^2) + (R^2 + r_i^2) / (R^2 - r_i^2)])

r_i is the bore of the pin (Timoshenko, Strength of Materials, part II, section 43).
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import latin_fmu
from latin_fmu.assembly.problem import DiscretisedProblem
from latin_fmu.building import discretise
from latin_fmu.fem.mesh import FacetSet, Mesh
from latin_fmu.stability.surfaces import turned, typed_box, write_mesh
from tests.scenes import ramp, solve

BORE, RADIUS, OUTER, HEIGHT = 2e-3, 10e-3, 16e-3, 2e-3
YOUNG, EXPANSION, FIT = 210e9, 1e-5, 10e-6


def lame(fit: float, radius: float = RADIUS, bore: float = BORE, outer: float = OUTER, young: float = YOUNG) -> float:
    """Pressure of a fit, Pa."""
    hub = (outer**2 + radius**2) / (outer**2 - radius**2)
    return fit * young / (radius * (hub + (radius**2 + bore**2) / (radius**2 - bore**2)))


def ring(
    kind: str, radii: tuple[float, float], elements: tuple[int, int, int], height: float, angle: float = np.pi / 2
) -> Mesh:
    """Sector of a ring about z: faces "inner", "outer", "first", "last", "foot", "top"."""
    box = typed_box(kind, np.zeros(3), np.ones(3), elements)
    names = {"xmin": "inner", "xmax": "outer", "ymin": "first", "ymax": "last", "zmin": "foot", "zmax": "top"}
    across, around, along = box.nodes.T
    radius = radii[0] + (radii[1] - radii[0]) * across
    places = np.stack([radius * np.cos(angle * around), radius * np.sin(angle * around), height * along], axis=1)
    return Mesh(
        places, box.blocks, {names[n]: FacetSet.of(*(b.facets for b in f.blocks)) for n, f in box.faces.items()}
    )


def fitted(
    folder: Path,
    overlap: float,
    kind: str = "hexahedron20",
    around: tuple[int, int] = (6, 8),
    size: float = 1.0,
    turn: np.ndarray | None = None,
    **interface: Any,
) -> dict[str, Any]:
    """A quarter of a pin in its hub, held by symmetry; ``overlap`` : radius of the pin less that of the hole, m.
    ``size`` : of all lengths. ``turn`` : of the axes."""
    rotation = np.eye(3) if turn is None else turn
    radii = {"pin": (BORE, RADIUS + overlap), "hub": (RADIUS, OUTER)}
    tables: dict[str, Any] = {"substructure": {}, "boundary": {}}
    for (name, (inner, outer)), n in zip(radii.items(), around, strict=True):
        mesh = ring(kind, (size * inner, size * outer), (3, n, 1), size * HEIGHT)
        write_mesh(folder / f"{name}.msh", mesh, lambda x: x @ rotation.T)
        tables["substructure"][name] = {"material": "steel", "mesh": {"file": str(folder / f"{name}.msh")}}
        tables["substructure"][name]["mesh"]["group"] = "body"
        for face in ("first", "last", "foot"):
            tables["boundary"][f"{name}_{face}"] = {"type": "symmetry", "face": f"{name}.{face}"}
    steel = {"young_modulus": YOUNG, "poisson_ratio": 0.3, "density": 7800.0, "thermal_expansion": EXPANSION}
    return tables | {
        "name": "fit",
        "material": {"steel": steel},
        "interface": {"fit": {"sides": ["pin.outer", "hub.inner"], **interface}},
        "time": {"end": 1.0, "instants": 2, "quasi_static": True},
    }


def heated(tables: dict[str, Any], change: float) -> dict[str, Any]:
    """The same with a hot pin."""
    law = ramp((0, 0), (1, 1))
    return tables | {"temperature": {"heat": {"substructures": ["pin"], "change": change, "law": law}}}


def pressure(tables: dict[str, Any]) -> float:
    """Mean pressure at the end, Pa."""
    made = solve(tables).interfaces["fit"]
    return float(made.pressure()[-1] @ made.areas / made.areas.sum())


def built(tables: dict[str, Any]) -> DiscretisedProblem:
    return discretise(latin_fmu.scene_from_dict(tables))


def gap(tables: dict[str, Any]) -> np.ndarray:
    return built(tables).units[0].geometry.gap


# -- clearances -----------------------------------------------------------------------------------------------------
@pytest.mark.parametrize("kind", ["hexahedron20", "tetra10", "hexahedron27"])
def test_a_small_clearance_of_quadratic_faces_counts(tmp_path: Path, kind: str) -> None:
    """5 um in a hole of 10 mm, chords 40 um from the circle; heated by 10 um the pin has the interference of 5 um."""
    tables = heated(fitted(tmp_path, -5e-6, kind), 100.0)
    assert gap(tables) == pytest.approx(5e-6, rel=0.02)
    assert pressure(tables) == pytest.approx(lame(EXPANSION * 100.0 * RADIUS - 5e-6), rel=0.03)


@pytest.mark.parametrize("seed", range(4))
def test_clearances_do_not_depend_on_the_axes_the_size_or_the_order(tmp_path: Path, seed: int) -> None:
    rng = np.random.default_rng(seed)
    size, turn = 10.0 ** rng.uniform(-3, 3), turned(rng.normal(size=3), float(rng.uniform(0, 180)))
    kind, play = ("hexahedron20", "tetra10")[seed % 2], 10.0 ** rng.uniform(-5.5, -4)
    around = tuple(int(n) for n in rng.integers(5, 12, 2))
    tables = fitted(tmp_path, -play, kind, (around[0], around[0] + around[1]), size, turn)
    tables["interface"]["fit"]["sides"] = tables["interface"]["fit"]["sides"][:: rng.choice([-1, 1])]
    assert gap(tables) == pytest.approx(size * play, abs=0.02 * size * play + 2e-7 * size)


def test_one_radius_touches_and_is_named_with_the_error(tmp_path: Path) -> None:
    unit = built(fitted(tmp_path, 0.0)).units[0]
    np.testing.assert_array_equal(unit.geometry.gap, 0.0)
    assert "touch (error of the measure: " in unit.note
    text = "\n".join(latin_fmu.check(latin_fmu.scene_from_dict(fitted(tmp_path, 0.0))))
    assert unit.note in text


def test_the_search_measures_as_an_interface_does(tmp_path: Path) -> None:
    tables = fitted(tmp_path, -5e-6)
    by_hand = gap(tables)
    del tables["interface"]
    tables["contact"] = {"all": {"search": 1e-4}}
    assert gap(tables) == pytest.approx(by_hand, rel=1e-6)


@pytest.mark.parametrize(("kind", "overlap"), [("hexahedron", -5e-6), ("tetra", -5e-6), ("hexahedron", 5e-6)])
def test_what_flat_facets_hide_is_refused(tmp_path: Path, kind: str, overlap: float) -> None:
    """Chords of 6 and 8 facets in a quarter, 85 um from the circle, know nothing of 5 um."""
    tables = fitted(tmp_path, overlap, kind)
    with pytest.raises(latin_fmu.SceneError) as caught:
        built(tables)
    said = str(caught.value)
    chord = RADIUS * (1 - np.cos(np.pi / 24))
    assert "interface.fit.gap" in said
    assert ("interference" if overlap > 0 else "clearance") in said
    assert float(said.split("are up to ")[1].split(" ")[0]) == pytest.approx(chord, rel=0.02)
    key = "interference" if overlap > 0 else "gap"
    tables["interface"]["fit"][key] = 5e-6
    np.testing.assert_array_equal(gap(tables), -overlap)


def test_the_pressure_of_a_clearance_given_for_flat_facets(tmp_path: Path) -> None:
    tables = heated(fitted(tmp_path, -5e-6, "hexahedron", (12, 16), gap=5e-6), 100.0)
    assert pressure(tables) == pytest.approx(lame(5e-6), rel=0.05)


@pytest.mark.parametrize("kind", ["hexahedron", "tetra"])
def test_flat_facets_of_one_radius_touch(tmp_path: Path, kind: str) -> None:
    np.testing.assert_array_equal(gap(fitted(tmp_path, 0.0, kind)), 0.0)


def test_the_number_counts_and_the_meshes_are_named(tmp_path: Path) -> None:
    """50 um between the meshes: within the error of the measure no remark, beyond it one with the distance."""
    tables = fitted(tmp_path, -50e-6, gap=50e-6)
    problem = built(tables)
    np.testing.assert_array_equal(problem.units[0].geometry.gap, 50e-6)
    assert "the meshes are" in problem.units[0].note
    assert not [r for r in problem.remarks if r.code == "gap"]
    tables["interface"]["fit"]["gap"] = 40e-6
    problem = built(tables)
    np.testing.assert_array_equal(problem.units[0].geometry.gap, 40e-6)
    remark = next(r for r in problem.remarks if r.code == "gap")
    assert "gap = 4e-05 m counts; the meshes are 4.99" in remark


# -- press fits -----------------------------------------------------------------------------------------------------
@pytest.mark.parametrize(("kind", "order"), [("hexahedron20", 1), ("tetra10", -1)])
def test_meshes_that_overlap_are_a_press_fit(tmp_path: Path, kind: str, order: int) -> None:
    tables = fitted(tmp_path, FIT, kind)
    tables["interface"]["fit"]["sides"] = tables["interface"]["fit"]["sides"][::order]
    solution = latin_fmu.solve(latin_fmu.scene_from_dict(tables))
    fit = solution.interfaces["fit"]
    for instant in (0, -1):
        mean = fit.pressure()[instant] @ fit.areas / fit.areas.sum()
        assert mean == pytest.approx(lame(FIT), rel=0.03)
    (overlap,) = (w for w in solution.warnings if "overlap by up to" in w)
    assert float(overlap.split("up to ")[1].split(" ")[0]) == pytest.approx(FIT, rel=0.02)
    (strain,) = (w for w in solution.warnings if "largest strain" in w)
    # hoop strain of the hub at the fit, its mean over an element
    assert 4e-4 < float(strain.split("largest strain is ")[1].split(",")[0]) < 1e-3


@pytest.mark.parametrize("units", ["SI", "mm-t-s-MPa"])
def test_a_press_fit_in_other_units_and_along_other_axes(tmp_path: Path, units: str) -> None:
    size, turn = (1.0, turned(np.array([1.0, 2.0, 3.0]), 40.0)) if units == "SI" else (1e3, None)
    tables = fitted(tmp_path, FIT, size=size, turn=turn)
    young = YOUNG if units == "SI" else YOUNG * 1e-6
    tables["units"] = units
    tables["material"]["steel"] |= {"young_modulus": young, "density": 7800.0 if units == "SI" else 7.8e-9}
    assert pressure(tables) == pytest.approx(lame(FIT) * young / YOUNG, rel=0.03)


@pytest.mark.parametrize("law", [{}, {"behaviour": "no_slip"}, {"behaviour": "soft_contact", "normal_stiffness": 1e17}])
@pytest.mark.parametrize("kind", ["hexahedron20", "hexahedron"])
def test_an_interference_by_its_number(tmp_path: Path, kind: str, law: dict[str, Any]) -> None:
    """On every law that opens, whatever the meshes; the layer of the soft contact takes 0.1 % of it."""
    tables = fitted(tmp_path, 0.0, kind, (12, 16), interference=FIT, **law)
    assert pressure(tables) == pytest.approx(lame(FIT), rel=0.05)


def test_the_fit_by_temperature_is_the_same(tmp_path: Path) -> None:
    """A pin of its hole's size that is heated by what the interference is: the pressure of the fit."""
    hot = pressure(heated(fitted(tmp_path, 0.0), FIT / RADIUS / EXPANSION))
    assert hot == pytest.approx(pressure(fitted(tmp_path, FIT)), rel=0.01)


def cubes(depth: float, **interface: Any) -> dict[str, Any]:
    """Two cubes of 10 mm between fixed ends."""
    box = {"size": [0.01, 0.01, 0.01], "elements": [2, 2, 4]}
    return {
        "name": "cubes",
        "material": {"m": {"young_modulus": YOUNG, "poisson_ratio": 0.0, "density": 7800.0}},
        "substructure": {
            "low": {"material": "m", "box": box},
            "high": {"material": "m", "box": {**box, "origin": [0.0, 0.0, 0.01 - depth]}},
        },
        "interface": {"c": {"sides": ["low.zmax", "high.zmin"], "friction_coefficient": 0.2, **interface}},
        "boundary": {n: {"type": "fixed", "face": f} for n, f in (("base", "low.zmin"), ("top", "high.zmax"))},
        "time": {"end": 1.0, "instants": 2, "quasi_static": True},
    }


FORCE = YOUNG * 1e-4 * 1e-5 / 0.02


def test_cubes_that_overlap_press_each_other() -> None:
    """E A d / 2 L = 10.5 kN, without inertia and from the static start of a motion, in which nothing moves."""
    tables = cubes(1e-5)
    assert solve(tables).interfaces["c"].force()[-1, 2] == pytest.approx(-FORCE, rel=1e-6)
    tables["time"] = {"end": 1e-4, "instants": 50}
    outcome = solve(tables | {"output": {"fields": True}})
    np.testing.assert_allclose(outcome.interfaces["c"].force()[:, 2], -FORCE, rtol=1e-6)
    moved = np.ptp(outcome.substructures["low"].displacement, axis=0)
    assert moved.max() < 1e-12


def test_overlaps_are_ignored_or_refused_by_choice() -> None:
    ignored = built(cubes(1e-5, overlap="ignore")).units[0]
    np.testing.assert_array_equal(ignored.geometry.gap, 0.0)
    assert "ignored" in ignored.note
    with pytest.raises(latin_fmu.SceneError, match="overlap at the start"):
        built(cubes(1e-5, overlap="refuse"))


@pytest.mark.parametrize(("overlap", "share"), [(6e-5, "0.6 %"), (1e-3, "10 %")])
def test_larger_overlaps_are_refused_with_both_readings(overlap: float, share: str) -> None:
    """Above 0.5 % of the thickness; below it is carried."""
    with pytest.raises(latin_fmu.SceneError) as caught:
        built(cubes(overlap))
    for words in ("overlap at the start", share, "0.5 %", "press fit", "thread", 'behaviour = "perfect"'):
        assert words in str(caught.value)
    assert built(cubes(4.9e-5)).units[0].geometry.gap == pytest.approx(-4.9e-5)


def test_strains_beyond_elasticity_are_refused() -> None:
    """A thin sleeve, by the number: 2 % of its length."""
    with pytest.raises(latin_fmu.SceneError, match=r"interface\.c\.interference.*strains.*0\.0[12]"):
        solve(cubes(0.0, interference=4e-4))


def test_a_fit_that_nothing_holds_is_told() -> None:
    tables = cubes(1e-5)
    del tables["boundary"]["top"]
    solution = latin_fmu.solve(latin_fmu.scene_from_dict(tables))
    assert any("press fit c carries no force" in w for w in solution.warnings)


def test_a_preload_beside_a_fit_is_refused() -> None:
    with pytest.raises(latin_fmu.SceneError, match=r"interface\.c\.preload.*press fit"):
        built(cubes(1e-5, preload=1e6))
    assert built(cubes(1e-5, preload=1e6, overlap="ignore")).units[0].preload == 1e6


def test_a_fit_with_a_moving_body_is_refused() -> None:
    tables = cubes(1e-5)
    del tables["boundary"]["top"]
    tables["time"] = {"end": 1e-4, "instants": 50}
    tables["substructure"]["high"]["initial_velocity"] = [0.0, 0.0, -1.0]
    with pytest.raises(latin_fmu.SceneError, match="initial velocity"):
        built(tables)


def test_the_fit_comes_before_the_loads() -> None:
    """A pull of less than the fit lowers the pressure, and the faces stay closed; then they part."""
    tables = cubes(1e-5)
    del tables["boundary"]["top"]
    tables["boundary"]["top"] = {
        "type": "displacement",
        "face": "high.zmax",
        "components": ["x", "y", "z"],
        "value": [0.0, 0.0, 1.5e-5],
        "law": ramp((0, 0), (1, 1)),
    }
    tables["time"]["instants"] = 3
    force = solve(tables).interfaces["c"].force()[:, 2]
    assert force == pytest.approx(np.array([-FORCE, -0.5 * FORCE, 0.0, 0.0]), rel=1e-6, abs=1e-6 * FORCE)


# -- bonds over a distance ------------------------------------------------------------------------------------------
def test_a_screw_larger_than_its_tapped_hole_is_bonded(tmp_path: Path) -> None:
    """0.5 mm on 10 mm: the parts hold together, and the distance is named."""
    problem = built(fitted(tmp_path, 0.5e-3, behaviour="perfect"))
    remark = next(r for r in problem.remarks if r.code == "overlap")
    assert "overlap by up to 0.0005" in remark
    with pytest.raises(latin_fmu.SceneError, match=r"into each other.*overlap = "):
        built(fitted(tmp_path, 3e-3, behaviour="perfect"))


def test_bonds_span_a_gap_up_to_the_search() -> None:
    with pytest.raises(latin_fmu.SceneError, match="bonded faces must touch"):
        built(cubes(-5e-5, behaviour="perfect") | _without_friction())
    tables = cubes(-5e-5) | _without_friction({"behaviour": "perfect", "search": 1e-4})
    problem = built(tables)
    assert any("are apart by up to 5e-05 m" in r for r in problem.remarks)
    assert not any("are apart" in r for r in built(cubes(0.0) | _without_friction({"behaviour": "perfect"})).remarks)


def _without_friction(keys: dict[str, Any] | None = None) -> dict[str, Any]:
    return {"interface": {"c": {"sides": ["low.zmax", "high.zmin"], **(keys or {"behaviour": "perfect"})}}}


def test_a_body_that_expands_freely_is_in_balance(tmp_path: Path) -> None:
    """The forces of a temperature cancel: what is left over of them is compared with their sizes."""
    solution = latin_fmu.solve(latin_fmu.scene_from_dict(heated(fitted(tmp_path, -50e-6), 100.0)))
    assert not [w for w in solution.warnings if "out of balance" in w]


def test_a_heated_scene_without_inertia_can_be_changed(tmp_path: Path) -> None:
    """Temperatures come in its increments: it has no start of its own, which it would refuse."""
    scene = latin_fmu.scene_from_dict(heated(fitted(tmp_path, 0.0), 100.0))
    assert scene.replace("time.instants", 3).time.instants == 3
