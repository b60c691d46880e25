"""Coupling with a neighbour FMU: a hammer on a spring drives the crushing, the crushing pushes it back.

The neighbour is an FMU of its own, written below: a mass thrown at the upper specimen through a spring. It takes the
velocity of the head and gives the load; the two exchange after every step (the simplest of masters).
"""

from __future__ import annotations

import tempfile
import textwrap
from contextlib import closing
from pathlib import Path

from pythonfmu import FmuBuilder

import latin_fmu
from fmu_build.build import build_fmu
from fmu_build.drive import FmuPeer

MODEL = Path(__file__).parents[1] / "models" / "two_specimen_crushing" / "scene.toml"
MASS, SPEED, STIFFNESS, AREA = 0.01, 8.0, 4e8, 1e-4  # kg, m/s, N/m, m2 of the loaded face
HAMMER = f'''
from xml.etree.ElementTree import SubElement
from pythonfmu import Fmi2Causality, Fmi2Slave, Fmi2Variability, Real


class Hammer(Fmi2Slave):
    """A mass on a spring; symplectic Euler in small steps. The spring only pushes."""

    def __init__(self, **kwargs):
        super().__init__(**kwargs)
        self.head_velocity, self.force, self.velocity, self.squeeze = 0.0, 0.0, {SPEED}, 0.0
        continuous = Fmi2Variability.continuous
        self.register_variable(Real("head_velocity", causality=Fmi2Causality.input, variability=continuous, start=0.0))
        for name in ("force", "velocity"):
            self.register_variable(Real(name, causality=Fmi2Causality.output, variability=continuous))

    def do_step(self, current_time, step_size):
        for _ in range(50):
            self.velocity -= self.force / {MASS} * step_size / 50
            self.squeeze += (self.velocity - self.head_velocity) * step_size / 50
            self.force = max(0.0, {STIFFNESS} * self.squeeze)
        return True

    def to_xml(self, model_options=dict()):
        root = super().to_xml(model_options)
        unknowns = SubElement(root.find("ModelStructure"), "InitialUnknowns")
        for index in ("2", "3"):
            SubElement(unknowns, "Unknown", index=index)
        return root
'''


def main() -> dict[str, float]:
    """Couple both; numbers that tests look at."""
    # scene: the load becomes an input, one unit is 1 Pa on the head
    scene = latin_fmu.load_scene(
        MODEL,
        [
            "load.press.law=input",
            "load.press.pressure=1.0",
            "time.step=0.3e-6",
            "sensor.head={substructure='upper', point=[0, 0, 0.02]}",
        ],
    )
    h, n, impulse, force = 0.3e-6, 160, 0.0, 0.0
    with tempfile.TemporaryDirectory() as folder:
        script = Path(folder) / "hammer_neighbour.py"
        script.write_text(textwrap.dedent(HAMMER))
        hammer_fmu = FmuBuilder.build_FMU(script, dest=Path(folder) / "Hammer.fmu")
        crushing_fmu = build_fmu(scene, Path(folder) / "crushing.fmu")
        with closing(FmuPeer(hammer_fmu)) as hammer, closing(FmuPeer(crushing_fmu)) as crushing:
            # solve
            for i in range(n):
                hammer.set("head_velocity", -crushing.value("sensor.head.velocity[3]"))
                assert hammer.step(i * h, h)
                before, force = force, hammer.value("force")
                crushing.set_load("press", before / AREA, (force - before) / AREA / h)
                assert crushing.step(i * h, h), crushing.complaint
                impulse += 0.5 * h * (before + force)
            rebound = hammer.value("velocity")
    # check: what the hammer lost is what the head received
    error = abs(impulse - MASS * (SPEED - rebound)) / (MASS * SPEED)
    print(f"hammer: {SPEED} m/s in, {rebound:.2f} m/s out; momentum off by {100 * error:.2f} %")
    return {"rebound": rebound, "error": error}


if __name__ == "__main__":
    main()
