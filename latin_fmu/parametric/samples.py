"""Samples of a scene whose parameters scatter, beside its bands to first order.

The points are a scrambled Sobol sequence in the probabilities of the parameters (A.B. Owen, Scrambling Sobol' and
Niederreiter-Xing points, J. Complexity 14 (1998) 466-489): 200 of them give the standard deviation of a sum of three
normal parameters to 1 %, random ones to 5 %. The band of samples is their mean +- k standard deviations, with the k of
the band to first order (``results.spread``): their quantiles at 95 % would be those of a few samples.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from .. import api
from ..accuracy.runs import Log
from ..errors import InputError, SolverError
from ..latin.outcome import Array
from ..reader import scene_from_dict
from ..results.dataset import datatree
from ..results.files import write_groups
from ..results.groups import StoredGroup, StoredVariable, finite, in_units
from ..results.sensitivities import DOUBT
from ..results.sentences import named_lines
from ..results.solution import Solution
from ..results.spread import PATH, SAMPLED, Bands, ResultBand, ends_of
from ..scene.quantity_table import in_words
from ..scene.readable_numbers import percent, readable
from ..scene.schema import Scene
from ..scene.spread import Distribution
from ..scene.units import SI, UnitSystem
from .point import CONVERGED, MOST_POINTS, SAMPLE, Grid, Parameter, Plan, Record
from .study import dataset_of, solved_points, tables_of

if TYPE_CHECKING:
    import xarray as xr

_WORDS: Final = {
    "mean": "mean",
    "deviation": "standard deviation",
    "low": "lower end of the band",
    "high": "upper end of the band",
}
_FEWEST: Final = 8
_HEADING: Final = "the samples cannot be made"


def sample_values(distributions: Mapping[str, Distribution], count: int, seed: int) -> tuple[Parameter, ...]:
    """Values of the parameters in ``count`` samples. A larger count begins with the same samples."""
    from scipy.special import ndtri
    from scipy.stats import qmc

    sequence = qmc.Sobol(len(distributions), scramble=True, seed=np.random.default_rng(seed))
    shares = sequence.random_base2(max(1, int(np.ceil(np.log2(count)))))[:count]
    made = []
    for (name, d), share in zip(distributions.items(), shares.T, strict=True):
        inside = np.clip(share, 1e-12, 1.0 - 1e-12)
        if d.uniform:
            standard = np.sqrt(12.0) * (inside - 0.5)
        else:
            standard = ndtri(inside)
        made.append(Parameter(name, tuple((d.mean + d.deviation * standard).tolist())))
    return tuple(made)


@dataclass(frozen=True)
class SampledBands:
    """Bands of samples beside those to first order.

    Attributes
    ----------
    bands : to first order. count : of samples that converged. scalars : bands of the samples by quantity.
    results : by path of their group and name of the variable. left_out : samples that failed or did not converge.
    """

    bands: Bands
    count: int
    scalars: Mapping[str, ResultBand]
    results: Mapping[str, Mapping[str, ResultBand]]
    left_out: int = 0

    @staticmethod
    def of(bands: Bands, records: Iterable[Record]) -> SampledBands:
        """From the records of the points; those that failed or did not converge do not count.

        Raises
        ------
        SolverError : fewer than two are left.
        """
        every_one = list(records)
        kept = [record[SAMPLE] for record in every_one if record["state"] == CONVERGED and SAMPLE in record]
        if len(kept) < 2:
            raise SolverError(f"{len(kept)} samples have converged: a band takes 2 at least")

        def band(values: Sequence[Array | float], factor: Array) -> ResultBand:
            every = np.array(values, dtype=float)
            return ResultBand(every.mean(axis=0), every.std(axis=0, ddof=1), factor)

        scalars = {
            q.quantity: band([s["scalars"].get(q.quantity, np.nan) for s in kept], q.band.factor)
            for q in bands.quantities
        }
        results = {
            path: {name: band([s["results"][path][name] for s in kept], b.factor) for name, b in of.items()}
            for path, of in bands.bands.items()
        }
        return SampledBands(bands, len(kept), scalars, results, len(every_one) - len(kept))

    def ratio(self, quantity: str) -> float:
        """Width of the band of a quantity to first order over that of the samples."""
        own = float(self.scalars[quantity].half)
        if own > 0.0:
            return float(self.bands[quantity].band.half) / own
        return np.nan

    def lines(self, units: UnitSystem = SI) -> list[str]:
        """One line a quantity: the band to first order and that of the samples."""
        made = []
        for q in self.bands.quantities:
            label, own = units.shown(q.unit), self.scalars[q.quantity]
            text = (
                f"{q.text(label)}; samples {readable(float(own.mean), label)} +- {readable(float(own.half), label, 3)}"
            )
            if np.isfinite(ratio := self.ratio(q.quantity)):
                text += f", to first order {percent(abs(ratio - 1.0))} {'wider' if ratio > 1.0 else 'narrower'}"
            made.append((in_words(q.quantity), text + DOUBT * q.flagged))
        head = [f"  {self.count} samples:"]
        if self.left_out:
            what = (
                "failed or did not converge: the bands of samples are without them, and too narrow; their messages are"
            )
            head = [f"  {self.count} samples; {self.left_out} more {what} in the study, give smaller spreads"]
        return [*head, *named_lines(made)]

    def report(self, units: UnitSystem = SI) -> dict[str, Any]:
        """As ``Bands.report``, with ``samples``, their number, and of each quantity ``sampled_mean``, ``sampled_low``
        and ``sampled_high``."""
        made = self.bands.report(units)
        for quantity, table in made["quantities"].items():
            own = self.scalars[quantity]
            table |= {f"{SAMPLED}_{key}": finite(float(getattr(own, key))) for key in ("mean", "low", "high")}
        return made | {"samples": self.count, "left_out": self.left_out}

    def groups(self, units: UnitSystem = SI) -> dict[str, StoredGroup]:
        """Groups of the bands with those of the samples in them, by path."""
        groups = self.bands.groups(units)
        whole = groups[PATH.rstrip("/")]
        for key, word in _WORDS.items():
            values = np.array([getattr(self.scalars[q.quantity], key) for q in self.bands.quantities])
            attrs = {"long_name": f"{word} of the samples, in the unit of the quantity"}
            whole.variables[f"{SAMPLED}_{key}"] = StoredVariable(("quantity",), values, attrs)
        whole.attrs["samples"] = self.count
        for path, bands in self.results.items():
            groups[path].variables.update(ends_of(self.bands.histories[path], bands, SAMPLED))
        return groups


def sample(
    scene: Scene | str | Path,
    count: int,
    output: str | Path | None = None,
    *,
    seed: int = 0,
    settings: Sequence[str] = (),
    jobs: int = 1,
    scheduler: str | None = None,
    log: Log | None = None,
    max_cpu: float | None = None,
) -> tuple[SampledBands, xr.DataTree]:
    """Solve a scene with samples of its table [spread], and once with derivatives: bands of both, and the study with
    them in its group ``spread``.

    Parameters
    ----------
    scene : file, or a scene. count : of samples. seed : of their sequence; a larger count begins with the same
        samples. output, settings, jobs, scheduler, log, max_cpu : as for ``sweep``.

    Raises
    ------
    InputError : no parameters that scatter, a count or seed out of range. SceneError : no derivatives of this scene.
    SolverError : the run or all but one of the samples do not converge. ResultsError : the output cannot be written.

    Examples
    --------
    >>> scene = latin_fmu.load_scene("models/impact_bar/scene.toml", ["time.instants=100"])
    >>> scene = scene.replace("spread", {"interface.wall.gap": "1 %"})
    >>> bands, study = latin_fmu.sample(scene, 8)
    >>> study.sizes["sample"], bands.count
    (8, 8)
    """
    tables, base_dir = tables_of(scene, settings)
    whole = scene_from_dict(tables, base_dir)
    if not whole.spread:
        what, remedy = "the scene has no parameters that scatter", "name some in the table [spread]"
        raise InputError.of(_HEADING, "--samples", what, remedy=remedy)
    if not _FEWEST <= count <= MOST_POINTS:
        raise InputError.of(_HEADING, "--samples", "number of samples", str(count), f"{_FEWEST} to {MOST_POINTS}")
    if not 0 <= seed < 2**63:
        raise InputError.of(_HEADING, "--seed", "out of range", str(seed), "an integer >= 0")
    solution = api.solve(whole)
    if solution.bands is None:
        raise SolverError(f"no bands to first order: {solution.status}; {'; '.join(map(str, solution.warnings))}")
    output_table = dict(tables.get("output", {})) | {"sensitivities": []}
    plain = {key: value for key, value in tables.items() if key != "spread"} | {"output": output_table}
    grid = Grid(plain, base_dir, sample_values(whole.distributions, count, seed), True)
    checked, records, done = solved_points(Plan(grid, max_cpu=max_cpu), output, jobs, scheduler, log)
    compared = SampledBands.of(solution.bands, records.values())
    groups = _groups(solution, compared, StoredGroup.of_dataset(dataset_of(grid, checked, records, False)))
    if output is not None:
        write_groups(groups, output)
    done()
    return compared, datatree(groups, whole.name)


def _groups(solution: Solution, compared: SampledBands, study: StoredGroup) -> dict[str, StoredGroup]:
    """Groups of the file: the study, derivatives and bands of the run."""
    assert solution.sensitivities is not None, "bands follow from derivatives"
    units = solution.units
    made = in_units(solution.sensitivities.groups(units) | compared.groups(units), units)
    study.attrs["scene"] = solution.scene_text
    return {"/": study, **made}
