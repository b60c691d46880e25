"""Cross-check files of an FMU: X_in.csv (inputs), X_ref.csv (outputs), X_ref.opt (start, stop, step, tolerance)."""

from __future__ import annotations

import csv
from collections.abc import Iterable, Mapping, Sequence
from contextlib import closing
from pathlib import Path

from latin_fmu.results.files import written_whole

from .drive import Drive


def write_cross_check(
    fmu: str | Path, folder: str | Path, inputs: Mapping[str, Sequence[float]] | None = None
) -> list[Path]:
    """Run the FMU over its default experiment and write the three files beside each other.

    inputs : columns over ``time``, by variable; none for an FMU without inputs.
    """
    name, place = Path(fmu).stem, Path(folder)
    with closing(Drive(fmu, None, inputs)) as drive:
        rows = list(drive.run(drive.step_size, drive.stop_time))
        header = ["time", *drive.outputs]
        experiment = drive.description.defaultExperiment
        options = {
            "StartTime": "0.0",
            "StopTime": repr(drive.stop_time),
            "StepSize": repr(drive.step_size),
            "RelTol": experiment.tolerance,
        }
    written = [place / f"{name}_ref.csv", place / f"{name}_ref.opt"]
    _table(written[0], header, rows)
    with written_whole(written[1]) as draft:
        draft.write_text("".join(f"{key}, {value}\n" for key, value in options.items()))
    if inputs:
        written.append(place / f"{name}_in.csv")
        _table(written[-1], list(inputs), zip(*inputs.values(), strict=True))
    return written


def _table(path: Path, header: Sequence[str], rows: Iterable[Sequence[float]]) -> None:
    with written_whole(path) as draft, draft.open("w", newline="", encoding="utf-8") as file:
        table = csv.writer(file)
        table.writerow(header)
        table.writerows([[repr(float(value)) for value in row] for row in rows])
