"""A session in an FMU of the exporter pythonfmu: forty lines, for a slave with code of its own around the solver.

Such an FMU runs in hosts that are a Python with this package, and one script of a name in a process. pythonfmu restores
registered variables alone: the state of the session is added below. `latin-fmu fmu` makes FMUs without these limits.
"""

from __future__ import annotations

import base64
import tempfile
from pathlib import Path

from pythonfmu import Fmi2Causality, Fmi2Slave, FmuBuilder, Real

import latin_fmu
from latin_fmu.cosim import Session

MODEL = Path(__file__).parents[1] / "models" / "two_specimen_crushing" / "scene.toml"


class Crushing(Fmi2Slave):
    """The crushing: pressure in, normal force and its largest value out."""

    def __init__(self, **given):
        super().__init__(**given)
        scene = Path(self.resources, "scene.toml")  # not there while pythonfmu asks for the variables
        self.session = Session(latin_fmu.load_scene(scene if scene.exists() else MODEL, ["load.press.law=input"]))
        self.press, self.force, self.largest = 0.0, 0.0, 0.0
        self.register_variable(Real("press", causality=Fmi2Causality.input))
        self.register_variable(Real("force", causality=Fmi2Causality.output))
        self.register_variable(Real("largest", causality=Fmi2Causality.output))

    def exit_initialization_mode(self):
        self.session.set_load("press", self.press)
        self.session.initialize()

    def do_step(self, current_time, step_size):
        self.session.set_load("press", self.press)
        report = self.session.step(current_time, step_size)
        if report:
            self.force = self.session.value("interface.crush.normalForce")
            self.largest = max(self.largest, self.force)
        return bool(report)

    def _get_fmu_state(self):
        return {**super()._get_fmu_state(), "state": base64.b64encode(self.session.snapshot()).decode()}

    def _set_fmu_state(self, state):
        self.session.restore(base64.b64decode(state["state"]))
        self.press, self.force, self.largest = (state[name] for name in ("press", "force", "largest"))


def build(folder: Path) -> Path:
    """The FMU, with the scene in its resources."""
    return Path(FmuBuilder.build_FMU(__file__, dest=str(folder), project_files=[str(MODEL)]))


def main() -> dict[str, float]:
    """Run it in FMPy; numbers that tests look at."""
    import fmpy

    with tempfile.TemporaryDirectory() as folder:
        rows = fmpy.simulate_fmu(
            str(build(Path(folder))), stop_time=3e-6, output_interval=3e-7, start_values={"press": 1.0}
        )
    print(f"normal force {rows['force'][-1]:.4g} N, largest {rows['largest'][-1]:.4g} N")
    return {"force": float(rows["force"][-1]), "largest": float(rows["largest"][-1])}


if __name__ == "__main__":
    main()
