"""What the stiffness of stress changes in the shipped models, and what looking for it costs.

    python examples/benchmarks/price_of_prestress.py [--rounds N] [--only MODEL ...] [--run MODEL ...]

  set-up   CPU seconds from the scene to operators that are ready, static start included, with effects.prestress =
           "automatic" over "off": median of the ratios of runs in turn, one thread
  change   largest change of the first ten elastic frequencies of the clamped assembly, "on" over "off", and whether
           "automatic" takes it

of models with a static start: no other has a stress at t = 0 by itself. With --run these models are run with "off",
"automatic" and "on", in turn: iterations an instant, CPU seconds, and how far the forces of all interfaces are from
those without (largest difference over the largest force).
"""

from __future__ import annotations

from argparse import ArgumentParser, RawDescriptionHelpFormatter
from collections.abc import Sequence
from pathlib import Path
from statistics import median

import numpy as np
from harness import cpu, tools
from threadpoolctl import threadpool_limits

import latin_fmu
from latin_fmu.building import build

MODELS = Path(__file__).resolve().parents[2] / "models"
MODES = 10


def chosen(file: Path, choice: str) -> latin_fmu.Scene:
    """The scene with a choice of ``effects.prestress``."""
    scene = latin_fmu.load_scene(file)
    effects = scene.effects.model_copy(update={"prestress": choice})
    changed: latin_fmu.Scene = scene.model_copy(update={"effects": effects})
    return changed


def price(file: Path, rounds: int) -> tuple[float, float]:
    """CPU seconds of the set-up without, and the median of its ratios with "automatic" over without."""
    scenes = [chosen(file, choice) for choice in ("off", "automatic")]
    ratios, seconds = [], []
    for i in range(rounds + 1):
        # each of them first in every other round, and the first one unmeasured
        order = scenes if i % 2 else scenes[::-1]
        found = {id(scene): cpu(lambda scene=scene: build(scene)) for scene in order}  # type: ignore[misc]
        without, automatic = (found[id(scene)] for scene in scenes)
        if i:
            seconds.append(without)
            ratios.append(automatic / without)
    return median(seconds), median(ratios)


def change(file: Path) -> str:
    """What stress does to the frequencies, and what the automatic choice does about it."""
    modes = {choice: latin_fmu.vibration_modes(chosen(file, choice), count=MODES) for choice in ("off", "on")}
    without, stressed = (m.frequency[m.n_rigid :] for m in modes.values())
    worst = int(np.argmax(np.abs(stressed / without - 1.0)))
    taken = any("changes natural" in remark for remark in latin_fmu.vibration_modes(chosen(file, "automatic")).remarks)
    return (
        f"{without[worst]:10.4f} {stressed[worst]:10.4f} Hz {100 * (stressed[worst] / without[worst] - 1):+8.4f} % "
        f"{'taken' if taken else 'left out'}"
    )


def runs(file: Path) -> None:
    """Print the runs of a model with each choice."""
    forces: dict[str, tools.Array] = {}
    for choice in ("off", "automatic", "on"):
        found: list[latin_fmu.Solution] = []
        seconds = cpu(lambda: found.append(latin_fmu.solve(chosen(file, choice))))  # noqa: B023
        solution = found[0]
        if not solution.converged:
            raise SystemExit(f"{file}: {solution.status}")
        windows = solution.outcome.windows
        iterations = sum(w.iterations * (w.last_instant - w.first_instant + 1) for w in windows) / len(solution.time)
        forces[choice] = np.concatenate([h.force().ravel() for h in solution.interfaces.values()])
        apart = float(np.abs(forces[choice] - forces["off"]).max() / np.abs(forces["off"]).max())
        same = "the same bits" if np.array_equal(forces[choice], forces["off"]) else f"forces {100 * apart:.3g} % apart"
        print(f"  {choice:10} {iterations:7.3f} iterations an instant {seconds:8.2f} s  {same}", flush=True)


def main(argv: Sequence[str] | None = None) -> None:
    """Print the tables."""
    parser = ArgumentParser(description=__doc__, formatter_class=RawDescriptionHelpFormatter)
    parser.add_argument("--rounds", type=int, default=7)
    parser.add_argument("--only", nargs="+", help="folders of models; none with an empty name")
    parser.add_argument("--run", nargs="*", default=[], help="folders of models that are run, too")
    given = parser.parse_args(argv)
    files = [file for file in sorted(MODELS.glob("*/*.toml")) if latin_fmu.load_scene(file).time.start.type == "static"]
    with threadpool_limits(1):
        for file in files:
            label = f"{file.parent.name}/{file.stem}"
            if given.only is None or file.parent.name in given.only:
                seconds, ratio = price(file, given.rounds)
                print(f"{label:24} set-up {seconds:8.3f} s {ratio:6.3f}   {change(file)}", flush=True)
            if file.parent.name in given.run:
                runs(file)


if __name__ == "__main__":
    main()
