"""What the session and the FMI layer cost on top of the solver, and what hosts pay for instances and reading.

Communication steps of one instant of three models: what a host pays for setting the loads, `doStep` and reading every
output, against the same step as a call of the kernels alone, one after the other, so that both find the machine alike.
Crushing of two specimens in communication steps of 50 instants: the kernels inside the FMU are timed from within. Then
a thousand steps whose sizes differ by round-off: operators are made once. Last, a host of its own, with a fresh
extraction.
"""

from __future__ import annotations

import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from contextlib import ExitStack, closing
from pathlib import Path
from typing import Any

import latin_fmu
from fmu_build.build import build_fmu
from fmu_build.drive import Drive, FmuPeer
from latin_fmu.assembly.interfaces import completed
from latin_fmu.cosim.communication import CommunicationRun
from latin_fmu.cosim.variables import RATE
from latin_fmu.kernels import entries

MODELS = Path(__file__).parents[2] / "models"
CRUSHING = "two_specimen_crushing"
LOADS = {CRUSHING: ("press",), "impact_bar": (), "hammer_on_plate": ()}  # set from outside
N_INSTANT, N_REPEAT, N_ROUNDED, N_SINGLE = 50, 9, 1000, 200


class Watch:
    """Adds up the CPU time inside a function of a module, and counts its calls."""

    def __init__(self, owner: Any, name: str) -> None:
        self.seconds, self.calls = 0.0, 0
        self._real: Callable[..., Any] = getattr(owner, name)
        setattr(owner, name, self._timed())

    def _timed(self) -> Callable[..., Any]:
        def timed(*arguments: Any) -> Any:
            start = time.process_time()
            try:
                return self._real(*arguments)
            finally:
                self.seconds += time.process_time() - start
                self.calls += 1

        return timed


def scene_of(model: str) -> latin_fmu.Scene:
    """A shipped model with loads from outside."""
    return latin_fmu.load_scene(
        MODELS / model / "scene.toml", [f"load.{n}.law={{type='input', start_value=0.8}}" for n in LOADS[model]]
    )


def inside(name: str) -> Any:
    """A module of the solver that travels in the FMU of this process."""
    return next(
        m for key, m in sys.modules.items() if key.startswith("latin_fmu_") and key.endswith(f".latin_fmu.{name}")
    )


def seconds(action: Callable[[], object]) -> float:
    """CPU time of a call (other programs on the machine do not count)."""
    start = time.process_time()
    action()
    return time.process_time() - start


def overhead(peer: FmuPeer, h: float) -> tuple[float, float]:
    """Medians over steps: kernels, s, and what the layers add, s."""
    state, watch = peer.snapshot(), Watch(inside("propagator.image").Image, "call")
    kernels, layers = [], []
    for i in range(N_REPEAT):
        before, start = watch.seconds, i * h
        total = seconds(lambda t=start: (peer.set_load("press", 0.8), peer.step(t, h), peer.read(peer.outputs)))  # type: ignore[misc]
        kernels.append(watch.seconds - before)
        layers.append(total - kernels[-1])
    peer.restore(state)
    return statistics.median(kernels), statistics.median(layers)


def single_steps(model: str) -> tuple[float, float]:
    """Medians of the CPU seconds of a step of one instant: all that a host pays, and a call of the kernels."""
    loads = LOADS[model]
    scene = scene_of(model)
    dt, run, spent = scene.time.time_step, CommunicationRun(completed(scene)), list[tuple[float, float]]()
    with tempfile.TemporaryDirectory() as folder, ExitStack() as stack:
        fmu = build_fmu(scene, Path(folder) / "a.fmu", python=True)
        peer = stack.enter_context(closing(FmuPeer(fmu)))

        def hosted(i: int) -> None:
            for name in loads:
                peer.set_load(name, 0.8)
            assert peer.step(i * dt, dt), peer.complaint
            peer.read(peer.outputs)

        def in_kernels() -> None:
            for name in loads:
                run.set(name, 0.8, 0.0)
            assert run.image.call(entries.COMMUNICATE, 1, RATE, 0, 1) == 1

        for i in range(min(N_SINGLE, scene.time.n_step)):
            host = seconds(lambda i=i: hosted(i))  # type: ignore[misc]
            spent.append((host, seconds(in_kernels)))
    host, kernels = (statistics.median(part[10:]) for part in zip(*spent, strict=True))
    return host, kernels


def rounded_steps(peer: FmuPeer, h: float) -> int:
    """How many times operators are made in a thousand steps of h that differ by round-off."""
    made = Watch(inside("propagator.direct"), "build_operators")
    state, t = peer.snapshot(), 0.0
    for i in range(N_ROUNDED):
        end = h * (i + 1)
        assert peer.step(t, end - t), peer.complaint  # the difference of two rounded times
        t = end
    peer.restore(state)
    return made.calls


def first_step(fmu: Path) -> float:
    """CPU seconds for initialization and the first step in a process of its own."""
    code = (
        "import sys, time; from fmu_build.drive import Drive; drive = Drive(sys.argv[1]); start = time.process_time(); "
        "drive.initialize(); assert drive.advance(0.0, drive.step_size); print(time.process_time() - start)"
    )
    done = subprocess.run([sys.executable, "-c", code, str(fmu)], capture_output=True, text=True, check=True)
    return float(done.stdout.split()[-1])


def main() -> dict[str, float]:
    """Measure; numbers that tests look at."""
    # scene
    scene = scene_of(CRUSHING)
    dt = scene.time.time_step

    # solve
    with tempfile.TemporaryDirectory() as folder:
        fmu = build_fmu(scene, Path(folder) / "crushing.fmu", python=True)
        Drive(fmu).close()  # the first instance of a process imports
        start = time.process_time()
        drive = Drive(fmu)
        instantiated = time.process_time() - start
        drive.close()
        with closing(FmuPeer(fmu)) as peer:
            solver, layers = overhead(peer, N_INSTANT * dt)
            made = rounded_steps(peer, 1.1 * dt)
            references = [peer.reference(peer.outputs[i % len(peer.outputs)]) for i in range(1000)]
            at_once = statistics.median(seconds(lambda: peer.read_references(references)) for _ in range(20))
            singly = seconds(lambda: [peer.read_references([r]) for r in references])
        first = first_step(fmu)
    single = {model: single_steps(model) for model in LOADS}

    # check
    share = layers / solver
    for model, (host, kernels) in single.items():
        times = f"{1e3 * host:8.3f} ms, {1e3 * kernels:.3f} in kernels alone, ratio {host / kernels:.2f}"
        print(f"one instant, {model:21s}{times}")
    print(f"kernels, {N_INSTANT} instants               {1e3 * solver:8.1f} ms")
    print(f"session and FMI on top            {1e3 * layers:8.2f} ms ({100 * share:.1f} %)")
    print(f"factorisations in {N_ROUNDED} rounded steps {made:6d} (one for each of the two specimens)")
    print(f"extract, instantiate, free        {1e3 * instantiated:8.1f} ms")
    print(f"start and first step              {first:8.2f} s")
    print(f"read 1000 outputs, at once        {1e3 * at_once:8.2f} ms, one by one {1e3 * singly:.1f} ms")
    host, kernels = single[CRUSHING]
    return {"overhead": share, "operators": made, "reading": at_once, "single": host, "kernels": kernels}


if __name__ == "__main__":
    main()
