"""What an FMU with Python needs Python for: the image of its run, made when a simulation begins.

The runtime in C (``runtime``) makes the steps. It has the image of the parameters and start values that the host has
set from here, and calls back where laws of the scene go on beyond its end, or where laws and factors are Python's.
"""

from __future__ import annotations

import ctypes
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from ..errors import InputError, Problem
from ..latin.settings import tolerance_for

if TYPE_CHECKING:
    from ..latin.outcome import Array
    from ..scene.schema import Scene
    from .handed_run import HandedRun
    from .settings import Settings
    from .started_run import StartedRun
    from .variable import Variable


class ImageMaker:
    """Makes the image of a scene.

    Parameters
    ----------
    scene : called once, when the scene is needed. warn : takes remarks on the scene, whenever it was built.
    """

    def __init__(self, scene: Callable[[], Scene], warn: Callable[[str], None]) -> None:
        self._load, self._warn = scene, warn
        self._written: Scene | None = None
        self._scene: Scene | None = None
        self._table: tuple[Variable, ...] = ()
        self._settings: Settings | None = None
        self._started: StartedRun | None = None
        self._handed: list[HandedRun] = []

    def make(self, numbers: Sequence[float], accuracy: float, starts: Sequence[float]) -> int:
        """Address of what C takes (``Process``), the same as before where nothing has changed that matters.

        Parameters
        ----------
        numbers : values of the variables of the FMU, those of ``scalar_table`` first. accuracy : relative accuracy that
            the host wants, 0 where it says nothing; it replaces the parameter ``tolerance``. starts : amplitudes of the
            inputs at the start.

        Raises
        ------
        InputError : a parameter out of range, a scene that cannot be built. SolverError : numbers overflow.
        """
        from ..arithmetic import computable
        from .handed_run import HandedRun
        from .input_table import inputs_of
        from .started_run import StartedRun
        from .table_file import Identity, table_file

        scene, settings = self._opened(), self._settings_of(numbers, accuracy)
        with computable():
            if self._started is None or settings != self._settings:
                applied = settings.applied(self._with_values(scene, settings))
                self._started, self._settings = StartedRun(applied, settings.tolerance), settings
            before = self._started.run
            run = self._started.of(dict(zip(inputs_of(scene), starts, strict=True)))
            if run is not before or not self._handed:
                table = table_file(self._table, scene, run, Identity("", endless=True))
                # C leaves the one before only when it has the new one
                self._handed = [*self._handed[-1:], HandedRun(run, table)]
                for remark in run.problem.warnings:
                    self._warn(remark)
        return ctypes.addressof(self._handed[-1].process)

    def _opened(self) -> Scene:
        from ..assembly.interfaces import completed
        from .variables import scalar_table

        if self._scene is None:
            self._written = self._load()
            self._scene = completed(self._written)
            self._table = tuple(scalar_table(self._scene))
        return self._scene

    def _with_values(self, scene: Scene, settings: Settings) -> Scene:
        """The scene, anew from how it is written where the host has set other numbers of it."""
        from ..assembly.interfaces import completed

        assert self._written is not None
        changed = settings.with_values(self._written)
        if changed is self._written:
            return scene
        return completed(changed)

    def _settings_of(self, numbers: Sequence[float], accuracy: float) -> Settings:
        from .settings import Settings

        number = {v.name: numbers[i] for i, v in enumerate(self._table) if v.causality == "parameter"}
        if accuracy > 0.0:
            tolerance = tolerance_for(accuracy)
        else:
            tolerance = number["tolerance"]
        return Settings(
            mode=int(number["mode"]),
            interpolation=int(number["inputInterpolation"]),
            time_step=number["timeStep"],
            end_time=number["endTime"],
            tolerance=tolerance,
            max_iterations=int(number["maxIterations"]),
            values=tuple((name, number[name]) for name in self._opened().fmu.parameters),
        )

    def history_table(self, path: str) -> str:
        """Histories in a netCDF file as the text of a CSV table: times, and a column for each variable over them.

        Raises
        ------
        InputError : the file cannot be read.
        """
        columns = _netcdf(Path(path))
        rows = zip(*(column.tolist() for column in columns.values()), strict=True)
        return "\n".join([",".join(columns), *(",".join(map(repr, row)) for row in rows), ""])

    def close(self) -> None:
        """Free the images."""
        self._handed, self._started = [], None


def _netcdf(file: Path) -> dict[str, Array]:
    import numpy as np
    import xarray as xr

    from ..file_digest import is_damaged

    def bad(what: str) -> InputError:
        return InputError([Problem(str(file), what)], "the load histories cannot be used")

    if not file.is_file():
        raise bad("no such file")
    try:
        if is_damaged(file):
            raise bad("the file is damaged: its digest does not match")
        # times as numbers, whatever unit the file names
        with xr.open_dataset(file, engine="netcdf4", decode_times=False, decode_timedelta=False) as dataset:
            columns = {str(name): np.asarray(v.values, dtype=float) for name, v in dataset.data_vars.items()}
            if "time" in dataset.coords:
                columns = {"time": np.asarray(dataset["time"].values, dtype=float), **columns}
    except InputError:
        raise
    except Exception as error:  # the library of a damaged file raises many kinds
        raise bad(f"cannot be read ({' '.join(str(error).split())[:200]})") from None
    if len({column.shape for column in columns.values()}) != 1 or next(iter(columns.values())).ndim != 1:
        raise bad("its variables are not columns of equal length")
    return columns
