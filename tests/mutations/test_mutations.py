"""The generator of mutants repeats itself and changes one expression; tests fail on one mutant of each kind."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path

import numpy as np
import pytest

from .generator import FOLDERS, KINDS, Mutant, all_sites, drawn, sites
from .run import COUNT, LEAST_RED, SEED, Copy, explained, quick_mutants, verdicts

PACKAGE = Path(__file__).parents[2] / "latin_fmu"

SOURCE = '''
import numpy as np
from numpy.typing import NDArray


def crossing(a: NDArray[np.float64], n: int) -> float:
    """Sum of 3 a_i up to the first a_i < 1; a + b in a docstring is no site."""
    total = 0.0
    for i in range(n - 1):
        if a[i + 1] < 1.0:
            return total - a[0] / 2.0
        total += 3.0 * a[i]
    raise ValueError(f"{n + 1} is too many")
'''
NUMBERS = np.array([5.0, 4.0, 2.0, 1.0, 0.5, 0.2])


def values(source: str) -> Iterator[float | str]:
    """What the function returns of some counts, or the error that it raises."""
    names: dict[str, object] = {}
    exec(compile(source, "crossing", "exec"), names)
    for n in (4, 5, 6):
        try:
            yield float(names["crossing"](NUMBERS, n))  # type: ignore[operator]
        except (IndexError, ValueError) as error:
            yield type(error).__name__


MUTANTS = [mutant for site in sites(SOURCE, "file.py") for mutant in site]


@pytest.mark.parametrize("mutant", MUTANTS, ids=lambda m: f"{m.before} becomes {m.after}")
def test_a_mutant_changes_the_values(mutant: Mutant) -> None:
    assert ast.dump(ast.parse(mutant.applied(SOURCE))) != ast.dump(ast.parse(SOURCE))
    assert list(values(mutant.applied(SOURCE))) != list(values(SOURCE))


def test_every_kind_is_there_and_nothing_that_is_only_said() -> None:
    assert {mutant.kind for mutant in MUTANTS} == set(KINDS)
    assert {mutant.line for mutant in MUTANTS} == {9, 10, 11, 12}


def test_a_seed_draws_the_same_mutants_of_different_lines() -> None:
    first, again, other = ([m for m, _ in zip(drawn(PACKAGE, seed), range(60), strict=False)] for seed in (1, 1, 2))
    assert first == again != other
    assert len({(m.file, m.line) for m in first}) == 60


def test_every_site_of_the_package_can_be_changed() -> None:
    """One mutant of each site still is Python, and differs."""
    every = all_sites(PACKAGE)
    assert {site[0].file.partition("/")[0] for site in every} == set(FOLDERS)
    assert len(every) > 3000
    for site in every[::80]:
        source = (PACKAGE / site[0].file).read_text(encoding="utf-8")
        for mutant in site:
            changed = mutant.applied(source)
            assert changed != source
            ast.parse(changed)


def test_explained_mutants_are_there() -> None:
    """Expressions change: an explanation goes with its own."""
    assert explained().keys() <= {mutant.key for site in all_sites(PACKAGE) for mutant in site}


def test_mutants_of_the_quick_check_are_there() -> None:
    mutants = [mutant for mutant, _ in quick_mutants()]
    assert len({mutant.key for mutant in mutants}) == len(mutants) == 26


@pytest.mark.slow
def test_mutants_are_judged_by_the_tests(tmp_path: Path) -> None:
    """The first of two kinds in the time schemes, which need no compiler; the file is as before after each."""
    every = [m for site in all_sites(PACKAGE) for m in site if m.function.endswith("predict")]
    with closing(Copy(tmp_path)) as copy:
        for kind in ("arithmetic", "operands"):
            mutant = next(m for m in every if m.kind == kind)
            assert copy.judge(mutant, ("time_scheme",)).colour == "red", mutant
        assert copy.test(("time_scheme",)) == ""


@pytest.mark.slow
def test_most_mutants_of_the_package_are_noticed() -> None:
    """An hour: see ``run.py``."""
    pytest.importorskip("ziglang")
    every = list(verdicts(SEED, COUNT))
    green = [v.mutant.key for v in every if v.colour == "green"]
    assert sum(v.colour == "red" for v in every) >= LEAST_RED, green
    assert set(green) <= explained().keys()
