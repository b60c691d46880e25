"""No answer depends on names, axes, units, neighbours, or on the way the instants are gone through.

A hundred random scenes take three relations each, drawn by their seed. ``pytest -m slow tests/relations`` takes all
relations on a thousand scenes and on shipped models. What a pair may differ by, and why, is in ``EXEMPT``.
"""

from __future__ import annotations

import sys
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Final, get_args

import numpy as np
import pytest

import latin_fmu
from latin_fmu.scene.fields import SceneTable
from latin_fmu.scene.schema import Scene
from tests.scenes import MODELS

from .random_scenes import Tables, random_scene
from .relations import NOT_TURNED, POINTS, RELATIONS, VECTORS, Relation, Run, distances, load_of, run

SHARE: Final = 0.05
"""Of all pairs: what a reason may cover at most."""
EXEMPT: Final = {
    "not converged": "one of both runs reports that it has not converged: it promises nothing",
    "sides alike": "sides that nothing tells apart exchange their points when they are swapped; a remark says so",
}
SAID: Final = "points are those of side E: facets, stiffness and volume"


class Pairs:
    """Pairs of runs that were compared, exempted, and too far apart."""

    def __init__(self) -> None:
        self.compared: Counter[str] = Counter()
        self.exempt: Counter[str] = Counter()
        self.faults: list[str] = []
        self.refused = 0

    def add(self, seed: object, tables: Tables, base: Run, relation: Relation, folder: Path) -> None:
        """Compare the second run of a relation with the first one of a scene."""
        rng = np.random.default_rng(_number(seed, relation))
        made = relation.change(tables, rng, folder)
        if made is None:
            return
        other, back = made
        second = run(other, folder, relation.solve)
        if bool(base.refused) and bool(second.refused) and not base.results:
            self.refused += 1
            return
        self.compared[relation.name] += 1
        reason = _reason(base, second, relation)
        if reason:
            self.exempt[reason] += 1
            return
        if not second.results or not base.results:
            self.faults.append(f"{seed} {relation.name}: {second.refused or base.refused}")
            return
        found = back(second.results)
        expected = {n: base.results[n] for n in found}
        if relation.name == "session":
            found, expected = ({n: v[1:] for n, v in r.items()} for r in (found, expected))
        apart = distances(expected, found, load_of(tables))
        worst = max(apart, key=lambda n: apart[n])
        if not apart[worst] <= relation.limit:
            self.faults.append(f"{seed} {relation.name}: {worst} by {apart[worst]:.2g}")

    def report(self) -> str:
        """Pairs by relation, exemptions by reason, and what is too far apart."""
        lines = [f"{sum(self.compared.values())} pairs, {self.refused} scenes of both refused alike"]
        lines += [f"  {name:18s} {count}" for name, count in self.compared.items()]
        lines += [f"  exempt: {self.exempt[reason]} {reason} ({why})" for reason, why in EXEMPT.items()]
        return "\n".join([*lines, *self.faults])

    def check(self) -> None:
        """Print the table, and fail where pairs are apart or a reason covers too many."""
        sys.stdout.write(f"{self.report()}\n")
        assert not self.faults, self.report()
        assert max(self.exempt.values(), default=0) <= SHARE * sum(self.compared.values()), self.report()


def _number(seed: object, relation: Relation) -> int:
    """A number of a pair that is the same in every run."""
    return int.from_bytes(f"{seed} {relation.name}".encode()[-8:], "little")


def _reason(base: Run, second: Run, relation: Relation) -> str:
    """Why a pair is not compared; empty where it is."""
    if not base.converged or not second.converged:
        return "not converged"
    if relation.name == "swapped" and any(SAID in warning for warning in base.warnings):
        return "sides alike"
    return ""


def test_no_answer_depends_on_the_description(tmp_path: Path) -> None:
    pairs = Pairs()
    for seed in range(100):
        tables = random_scene(seed)
        base = run(tables, tmp_path)
        rng = np.random.default_rng([seed, 1])
        for name in rng.choice(sorted(RELATIONS), 3, replace=False).tolist():
            pairs.add(seed, tables, base, RELATIONS[name], tmp_path)
    pairs.check()


@pytest.mark.slow
@pytest.mark.parametrize("block", range(20))
def test_all_relations_on_many_scenes(block: int, tmp_path: Path) -> None:
    pairs = Pairs()
    for seed in range(1000 + 50 * block, 1050 + 50 * block):
        tables = random_scene(seed)
        base = run(tables, tmp_path)
        for relation in RELATIONS.values():
            pairs.add(seed, tables, base, relation, tmp_path)
    pairs.check()


PLAIN: Final = (
    *("beam_in_traction", "bouncing_bar", "gripped_bar", "hammer_on_plate", "impact_bar", "shear_interface"),
)
"""Models of boxes."""
NOT_OF_MODELS: Final = ("cut by a bond", "moving frame")


@pytest.mark.slow
@pytest.mark.parametrize("model", PLAIN)
def test_all_relations_on_shipped_models(model: str, tmp_path: Path) -> None:
    tables = latin_fmu.load_scene(MODELS / model / "scene.toml").tables()
    tables["solver"] = {"tolerance": 1e-9, "max_iterations": 1000}
    tables["output"] = {"energy": True}
    tables.pop("accuracy", None)
    base, pairs = run(tables, tmp_path), Pairs()
    for relation in RELATIONS.values():
        if relation.name not in NOT_OF_MODELS:
            pairs.add(model, tables, base, relation, tmp_path)
    pairs.check()


def _tables(table: type[SceneTable], known: set[type[SceneTable]]) -> Iterator[type[SceneTable]]:
    """Every table of the schema."""
    if table in known:
        return
    known.add(table)
    yield table
    for field in table.model_fields.values():
        for inner in _types(field.annotation):
            if isinstance(inner, type) and issubclass(inner, SceneTable):
                yield from _tables(inner, known)


def _types(annotation: Any) -> Iterator[Any]:
    yield annotation
    for inner in get_args(annotation):
        yield from _types(inner)


def test_every_vector_of_the_schema_is_turned_or_is_none() -> None:
    """A new field with three numbers has to be named in one of the lists of ``relations``."""
    found = {
        name
        for table in _tables(Scene, set())
        for name, field in table.model_fields.items()
        if any(len(get_args(t)) == 3 and set(get_args(t)) != {int} and _numbers(t) for t in _types(field.annotation))
    }
    assert {"initial_velocity", "normal", "point"} <= found
    assert found <= {*POINTS, *VECTORS, *NOT_TURNED}, found - {*POINTS, *VECTORS, *NOT_TURNED}


def _numbers(annotation: Any) -> bool:
    """Whether a type is that of three numbers."""
    inner = [(a, *get_args(a))[:2] for a in get_args(annotation)]
    return getattr(annotation, "__origin__", None) is tuple and all(float in pair for pair in inner)
