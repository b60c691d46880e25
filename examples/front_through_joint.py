"""A front through a joint that is closed from the start: what each time scheme leaves behind it.

Two equal bars (E, rho and length 1, nu = 0) in a line, no friction, a pulse of one second on the end of the first,
sudden or with a rise over four elements. By characteristics the joint carries the pulse from L/c on and separates when
it has passed: nothing acts there any more, and no energy is lost. Bonded bars show what mesh and scheme make of the
front where no joint opens. After the separation the default leaves no pressure, HHT up to 21 % of the pulse. Prints a
table, and the error of the schemes under a load that grows slowly (two crushed specimens against a mesh three times as
fine). Two minutes. Writes front_through_joint.png.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from example_tools import EXACT, MODELS, Array, options, save, table, tidy
from matplotlib.figure import Figure

import latin_fmu
from latin_fmu.pictures.style import curve_styles
from latin_fmu.stability.scenes import Box, Material, column

LENGTH, PULSE, END, SLACK = 1.0, 1.0, 4.0, 0.25
"""Of a bar, m; durations of the pulse and of the run, s; time after the exact separation that the front may take, s."""
SCHEMES: dict[str, Any] = {"hht": "hht", "massless_contact": "massless_contact", "default": None}
LOOKS = dict(zip(SCHEMES, curve_styles(len(SCHEMES)), strict=True))
MEASURES = (
    "pressure after separation, %",
    "peak over bonded",
    "energy lost at the joint, %",
    "impulse beyond, %",
    "L2 error of the pressure, %",
)


def main(argv: Sequence[str] | None = None) -> dict[str, float]:
    """Solve, print, draw, and return the checked numbers."""
    arguments = options(argv, __doc__)
    meshes = (40,) if arguments.quick else (40, 80, 160)
    found = {(n, r, s): measured(n, r, SCHEMES[s]) for n in meshes for r in (0, 4) for s in SCHEMES}
    print("| | elements | " + " | ".join(SCHEMES) + " |\n|---|---|" + "---|" * len(SCHEMES))
    for i, name in enumerate(MEASURES):
        for n in meshes:
            cells = ("; ".join(f"{found[n, rise, scheme][i]:.2f}" for rise in (0, 4)) for scheme in SCHEMES)
            print(f"| {name} | {n} | {' | '.join(cells)} |")
    save(drawn(40 if arguments.quick else 80), arguments.folder, "front_through_joint")
    numbers = {f"{s}, {name}": x for s in SCHEMES for name, x in zip(MEASURES, found[meshes[0], 0, s], strict=True)}
    for scheme in ("hht", "generalized_alpha"):
        for n in (6,) if arguments.quick else (6, 9):
            numbers[f"crushing, {n} elements, {scheme}: L2 error, %"] = crushing_error(scheme, n, arguments.quick)
    print(table(numbers))
    return numbers


def bars(elements: int, rise: float, scheme: Any = None, bonded: bool = False) -> dict[str, Any]:
    """The scene; ``rise`` of the pulse in elements, ``scheme``: None for the default."""
    parts = {name: Box(Material(1.0, 1.0, 0.0), (0.1, 0.1, LENGTH), (1, 1, elements)) for name in ("a", "b")}
    joint = {"behaviour": "perfect"} if bonded else {"friction_coefficient": 0.0}
    time = {"end": END, "instants": round(2 * END * elements / LENGTH)}
    scene = column(parts, {"joint": joint}, time, output={"energy": True})
    sides = [(name, side) for name in parts for side in ("xmin", "xmax", "ymin", "ymax")]
    scene["boundary"] = {f"{name}_{side}": {"type": "symmetry", "face": f"{name}.{side}"} for name, side in sides}
    scene["time"] |= {"scheme": scheme} if scheme else {}
    last = rise * LENGTH / elements
    points = [(0.0, 0.0), (last, 1.0), (PULSE, 1.0), (PULSE + last, 0.0), (END, 0.0)]
    if rise == 0:
        points = [(0.0, 1.0), (PULSE, 1.0), (PULSE + 1e-9, 0.0), (END, 0.0)]
    law = {"type": "table", "times": [t for t, _ in points], "values": [v for _, v in points]}
    scene["load"] = {"push": {"face": "a.zmin", "traction": [0.0, 0.0, 1.0], "law": law}}
    return scene


def solved(elements: int, rise: float, **changes: Any) -> tuple[latin_fmu.Solution, Array]:
    """The solution, and the mean pressure of the joint over time, Pa."""
    solution = latin_fmu.solve(latin_fmu.scene_from_dict(bars(elements, rise, **changes)))
    assert solution.converged, solution.status
    return solution, np.abs(solution.interfaces["joint"].traction[:, :, 2]).mean(axis=1)


def kept(solution: latin_fmu.Solution, rise: float, elements: int) -> float:
    """Kinetic and elastic energy over the work of the load, while the pulse crosses the second bar."""
    energy, last = solution.energy, rise * LENGTH / elements
    assert energy is not None
    during = (solution.time > 2.2 + last) & (solution.time < 2.9)
    return float((energy["kinetic"] + energy["elastic"])[during].mean() / energy["work_of_loads"][during].mean())


def measured(elements: int, rise: float, scheme: Any) -> tuple[float, ...]:
    """The MEASURES; bonded bars with the same scheme, with hht for ``massless_contact``, which they do not have."""
    solution, pressure = solved(elements, rise, scheme=scheme)
    same = {"massless_contact": "hht", None: "generalized_alpha"}.get(scheme, scheme)
    bonded, through = solved(elements, rise, scheme=same, bonded=True)
    last = rise * LENGTH / elements
    after = solution.time > LENGTH + PULSE + last + SLACK
    corners = LENGTH + np.array([0.0, last + 1e-9, PULSE, PULSE + last + 1e-9])
    exact = np.interp(solution.time, corners, [0.0, 1.0, 1.0, 0.0])
    lost = kept(bonded, rise, elements) - kept(solution, rise, elements)
    impulse = float(np.trapezoid(pressure, solution.time))
    behind, peak = float(pressure[after].max()), float(pressure.max() / through.max())
    error = float(np.sqrt(np.trapezoid((pressure - exact) ** 2, solution.time) / PULSE))
    return 100 * behind, peak, 100 * lost, 100 * (impulse / PULSE - 1.0), 100 * error


def drawn(elements: int) -> Figure:
    """Pressure of the joint over time, sudden pulse."""
    figure = Figure(figsize=(7.0, 3.2), layout="constrained")
    axis = figure.add_subplot(xlabel="time, L/c", ylabel="pressure of the joint / pulse")
    axis.plot([0.0, 1.0, 1.0, 2.0, 2.0, 3.0], [0.0, 0.0, 1.0, 1.0, 0.0, 0.0], **EXACT)
    for name, scheme in SCHEMES.items():
        solution, pressure = solved(elements, 0, scheme=scheme)
        axis.plot(solution.time, pressure, label=name, **LOOKS[name])
    axis.set_xlim(0.8, 3.0)
    axis.legend(frameon=False)
    tidy(axis)
    return figure


def crushing_error(scheme: str, elements: int, quick: bool) -> float:
    """L2 error of the force between two crushed specimens against HHT on a fine mesh, %."""
    time, force = crushed(scheme, elements)
    fine_time, fine = crushed("hht", 12 if quick else 18)
    exact = np.interp(time, fine_time, fine)
    return float(100 * np.linalg.norm(force - exact) / np.linalg.norm(exact))


def crushed(scheme: str, elements: int) -> tuple[Array, Array]:
    """Instants, s, and force between the specimens, N; steps in proportion to the elements."""
    changes = [f"substructure.{body}.box.elements=[{elements}, {elements}, {elements}]" for body in ("lower", "upper")]
    changes += [f"time.step={0.9e-6 / elements}", f'time.scheme="{scheme}"', "output.fields=false"]
    solution = latin_fmu.solve(latin_fmu.load_scene(MODELS / "two_specimen_crushing" / "scene.toml", changes))
    return solution.time, np.abs(solution.interfaces["crush"].normal_resultant())


if __name__ == "__main__":
    main()
