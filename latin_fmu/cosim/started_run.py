"""The run of a scene for the amplitudes that its inputs have at the start of a simulation."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from ..arithmetic import computable
from ..errors import SolverError
from ..kernels.communication import FREE
from ..scene.laws import InputLaw
from ..scene.schema import Scene
from .communication import CommunicationRun
from .input_table import given_of, with_laws


class StartedRun:
    """A run that is made when it is first needed, and anew where its initial state depends on other amplitudes.

    Parameters
    ----------
    scene : with names for its interfaces, as it is solved. tolerance : replaces that of the scene.

    Attributes
    ----------
    run : None before it is needed. starts : amplitudes at the start that it was made for.
    """

    def __init__(self, scene: Scene, tolerance: float | None = None) -> None:
        self._scene, self._tolerance = scene, tolerance
        self.run: CommunicationRun | None = None
        self.starts: dict[str, float] = {}

    def of(self, starts: Mapping[str, float]) -> CommunicationRun:
        """The run for these amplitudes: the one that is there, where they make no difference.

        Raises
        ------
        SceneError : the scene cannot be built. SolverError : numbers overflow, a matrix is singular.
        """
        if self.run is None:
            try:
                return self.made_for(starts)
            except SolverError:  # amplitudes that overflow matter at the start only where it depends on them
                self.made_for({source.name: source.start for source in given_of(self._scene)})
        assert self.run is not None
        if any(starts[name] != self.starts[name] for name in _held(self.run)):
            return self.made_for(starts)
        return self.run

    def made_for(self, starts: Mapping[str, float]) -> CommunicationRun:
        """A new run for these amplitudes."""
        self.forget()
        laws = {name: InputLaw(start_value=value) for name, value in starts.items()}
        if laws:
            scene = with_laws(self._scene, laws)
        else:
            scene = self._scene
        with computable():
            self.run, self.starts = CommunicationRun(scene, self._tolerance, python=True), dict(starts)
        return self.run

    def forget(self) -> None:
        """Drop the run."""
        self.run = None


def _held(run: CommunicationRun) -> list[str]:
    """Inputs whose amplitude at the start the image holds for alone."""
    image, names = run.image, run.sources.inputs
    at = image.run_fields["input_held"]
    constraints = image.fixed[at : at + len(names)].view(np.int64)
    return [name for name, kind in zip(names, constraints.tolist(), strict=True) if kind != FREE]
