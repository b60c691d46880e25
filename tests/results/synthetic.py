"""Outcomes made up from smooth curves, to test what reads them without running the solver."""

from __future__ import annotations

import numpy as np

from latin_fmu.latin.outcome import Array, InterfaceHistory, Outcome, SubstructureHistory, Timings, WindowRecord

SIDE = 0.01


def contact(
    name: str,
    time: Array,
    start: float,
    end: float,
    peak: float,
    friction: float = 0.1,
    n: int = 4,
    level: float = 0.01,
) -> InterfaceHistory:
    """A square contact pressed by a half-sine pressure between ``start`` and ``end``; friction grows outwards."""
    x, y = (axis.ravel() for axis in np.meshgrid(np.linspace(0, SIDE, n), np.linspace(0, SIDE, n)))
    points = np.stack([x, y, np.full(n * n, level)], axis=1)
    areas = np.full(n * n, SIDE**2 / (n * n))
    normals = np.tile([0.0, 0.0, 1.0], (n * n, 1))
    pulse = np.where((time > start) & (time < end), np.sin(np.pi * (time - start) / (end - start)), 0.0)
    pressure = peak * np.clip(pulse, 0, None)[:, None] * (1 - 0.2 * x / SIDE)
    radius = np.hypot(x, y) / SIDE
    shear = np.minimum(0.3 * radius * pressure, friction * pressure)
    closed = pressure > 0
    slipping = closed & (0.3 * radius * pressure >= friction * pressure)
    traction = np.zeros((time.size, n * n, 3))
    traction[:, :, 0] = -shear
    traction[:, :, 2] = -pressure
    velocity = np.zeros((time.size, 2, n * n, 3))
    velocity[:, 0, :, 2] = 2.0 * closed
    velocity[:, 1, :, 2] = 2.0 * closed
    gap = np.where(closed, -1e-10, 1e-6 * np.abs(time - end)[:, None] / time[-1])
    return InterfaceHistory(
        name=name,
        behaviour="contact",
        sides=("lower.zmax", "upper.zmin"),
        points=points,
        areas=areas,
        normals=normals,
        initial_gap=np.zeros(n * n),
        friction_coefficient=friction,
        traction=traction,
        velocity=velocity,
        gap=gap,
        contact_status=(closed.astype(np.int8) + slipping.astype(np.int8)).astype(np.int8),
        friction_power=np.einsum("p,tp->t", areas, shear) * 0.5 if friction else None,
    )


def joint(name: str, time: Array) -> InterfaceHistory:
    """A perfect connection that carries a compression then a tension."""
    base = contact(name, time, 0.0, time[-1], 1e8, friction=0.0, n=2)
    traction = base.traction * np.cos(2 * np.pi * time / time[-1])[:, None, None]
    return InterfaceHistory(
        **{**base.__dict__, "behaviour": "perfect", "friction_coefficient": None, "traction": traction}
        | {"gap": None, "contact_status": None, "friction_power": None}
    )


def block(name: str, time: Array, every: int = 2, level: float = 0.0) -> SubstructureHistory:
    """One cube of eight nodes with every field."""
    corners = [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [0, 0, 1], [1, 0, 1], [1, 1, 1], [0, 1, 1]]
    nodes = SIDE * np.array(corners, dtype=float) + np.array([0, 0, level])
    stored = time[::every]
    wave = np.sin(2 * np.pi * stored / time[-1])[:, None, None]
    stress = np.zeros((stored.size, 1, 6))
    stress[:, 0, :] = np.sin(np.pi * stored / time[-1])[:, None] * np.array([1, 2, -30, 4, 5, 6]) * 1e6
    return SubstructureHistory(
        name=name,
        nodes=nodes,
        cells=np.arange(8, dtype=np.int64)[None, :],
        cell_type="hexahedron",
        time=stored,
        displacement=1e-6 * wave * np.ones((1, 8, 3)),
        velocity=2.0 * wave * np.ones((1, 8, 3)),
        stress=stress,
        energy=_energy(time),
    )


def silent_block(name: str, time: Array) -> SubstructureHistory:
    """A substructure without requested output."""
    full = block(name, time)
    nothing = {"displacement": None, "velocity": None, "stress": None, "energy": None}
    return SubstructureHistory(**full.__dict__ | nothing)


def _energy(time: Array) -> dict[str, Array]:
    phase = time / time[-1]
    work = 3.0 * np.sin(0.5 * np.pi * phase) ** 2
    return {
        "kinetic": 0.4 * work,
        "elastic": 0.45 * work,
        "prestress": np.zeros_like(work),
        "work_of_loads": work,
        "interface_work": -0.01 * work,
        "damping_dissipation": np.zeros_like(work),
        "scheme_dissipation": 0.05 * work,
        "landing_dissipation": np.zeros_like(work),
    }


def windows(n_time: int, length: int, n_iteration: int = 4) -> list[WindowRecord]:
    """Converging windows of ``length`` instants, with between ``n_iteration`` and twice as many iterations."""
    records = []
    for first in range(1, n_time, length):
        count = n_iteration + (first * 7919) % (n_iteration + 1)
        curve = [float(10 ** (-3.2 * (i + 1) / count)) for i in range(count)]
        force_residual = [float("nan")] * (count - 1) + [1e-3]
        records.append(WindowRecord(first, min(first + length, n_time) - 1, curve, force_residual, [], True))
    return records


def crushing(n_time: int = 201, window: int = 1, friction: float = 0.1) -> Outcome:
    """Two blocks, one frictional contact, energy terms, one-step windows by default."""
    time = np.linspace(0.0, 30e-6, n_time)
    history = contact("crush", time, 3e-6, 16.8e-6, 4e8, friction)
    energy = {**_energy(time), "friction_dissipation": 0.1 * _energy(time)["work_of_loads"]}
    energy["balance"] = 1e-11 * energy["kinetic"]
    return Outcome(
        time=time,
        interfaces={"crush": history},
        substructures={"lower": block("lower", time), "upper": silent_block("upper", time)},
        windows=windows(n_time, window),
        interface_indicator={"crush": 6.3e-4},
        converged=True,
        status="converged: every window reached the tolerance 1e-3",
        passes=5.5,
        energy=energy,
        timings=Timings(0.3, 0.63, 0.05, 0.0, 1.2, 120_000_000),
        warnings=("the pulse is sampled with an impulse 0.2 % too small",),
        settings={"search direction, one instant": "diagonal"},
    )


def stack(n_interface: int = 16, n_time: int = 201) -> Outcome:
    """Many contacts loaded one after the other."""
    time = np.linspace(0.0, 40e-6, n_time)
    interfaces = {}
    for i in range(n_interface):
        start = 1e-6 + 1.8e-6 * i
        name = f"contact_{i + 1}"
        interfaces[name] = contact(name, time, start, start + 12e-6, 2e8 * 0.95**i, 0.2, level=SIDE * (i + 1))
    base = crushing(n_time)
    changes = {"time": time, "interfaces": interfaces, "substructures": {}, "energy": None, "warnings": ()}
    indicator = dict.fromkeys(interfaces, 0.0005)
    return Outcome(**base.__dict__ | changes | {"interface_indicator": indicator})


def bars(converged: bool = True) -> Outcome:
    """Case of one window: a joint and a frictionless contact."""
    time = np.linspace(0.0, 575e-6, 251)
    interfaces = {
        "joint": joint("joint", time),
        "contact": contact("contact", time, 222e-6, 290e-6, 1e8, friction=0.0, n=2),
    }
    curve = [0.7, 0.31, 0.08, 0.011, 2.3e-3, 6e-4] if converged else [0.7, 0.5, 0.45, 0.44, 0.44]
    record = WindowRecord(1, 250, curve, [float("nan")] * len(curve), [], converged)
    if not converged:
        record.fallbacks.append("relaxation 1/2 from the best iterate")
    sentence = "converged" if converged else "not converged: interface 'contact' stalls; use shorter windows"
    changes = {
        "time": time,
        "interfaces": interfaces,
        "substructures": {},
        "windows": [record],
        "interface_indicator": {"joint": 2e-4, "contact": curve[-1]},
        "converged": converged,
        "status": sentence,
        "energy": None,
        "warnings": (),
    }
    return Outcome(**crushing().__dict__ | changes)
