"""Random scenes, small enough for hundreds of runs: bodies in a row with every kind of joint, load and start, and
plates in a clamp whose bolt is tightened.

A box may have the key ``cells``, which no scene has: ``relations.written`` puts a mesh file of such cells in its place.
"""

from __future__ import annotations

from typing import Any

import numpy as np

Tables = dict[str, Any]
Random = np.random.Generator
INSTANTS = 10
SCHEMES = ("automatic", "automatic", "hht", "newmark", "generalized_alpha")
CELLS = ("tetra", "tetra10", "wedge", "hexahedron20", "pyramid")
"""Of bodies that come as mesh files."""
JOINTS = ("contact", "contact", "contact", "no_slip", "perfect", "elastic_layer", "soft_contact", "viscous_joint")
OPENING = ("contact", "no_slip", "soft_contact")


def random_scene(seed: int) -> Tables:
    """A scene as tables: one in eight with a bolt, and of the others one in six with a body from a mesh file."""
    rng = np.random.default_rng([seed, 2])
    if rng.random() < 0.125:
        return clamp_scene(seed)
    tables = row_scene(seed)
    if rng.random() < 1.0 / 6.0:
        name = f"b{int(rng.integers(len(tables['substructure'])))}"
        tables["substructure"][name]["box"]["cells"] = str(rng.choice(CELLS))
    return tables


def clamp_scene(seed: int) -> Tables:
    """Two plates, ``lower`` held, between the jaws of a clamp whose shank is tightened beside them."""
    rng = np.random.default_rng([seed, 3])
    size = 10.0 ** rng.uniform(-2.5, -1.0)
    stuffs = [_stuff(rng) for _ in range(3)]
    length, width, thick, low, jaw = size * rng.uniform([3.0, 1.0, 0.5, 0.5, 0.5], [5.0, 2.0, 1.0, 1.0, 1.0])
    x, reach = size * rng.uniform(0.3, 1.0), size * rng.uniform(1.0, 1.5)
    bodies = {  # material, origin, size, elements
        "lower": (0, (0.0, 0.0, -low), (length, width, low), (3, 2, 1)),
        "upper": (1, (0.0, 0.0, 0.0), (length, width, thick), (2, 2, 2)),
        "head": (2, (x, 0.5 * width, thick), (reach, width, jaw), (2, 2, 1)),
        "nut": (2, (x, 0.5 * width, -low - jaw), (reach, width, jaw), (2, 2, 1)),
        "shank": (2, (x + 0.25 * reach, width, -low), (0.5 * reach, 0.4 * width, low + thick), (1, 1, 4)),
    }
    tables: Tables = {
        "name": f"relation_{seed}",
        "material": {f"m{i}": stuff for i, stuff in enumerate(stuffs)},
        "substructure": {
            name: {
                "material": f"m{of}",
                "box": {"origin": [float(v) for v in origin], "size": [float(v) for v in edges], "elements": [*counts]},
            }
            for name, (of, origin, edges, counts) in bodies.items()
        },
    }
    pairs = {"joint": "lower.zmax upper.zmin", "over": "upper.zmax head.zmin", "under": "nut.zmax lower.zmin"}
    friction = rng.choice([0.1, 0.2, 0.4], 3).tolist()
    tables["interface"] = {
        name: {"sides": sides.split(), "friction_coefficient": mu}
        for (name, sides), mu in zip(pairs.items(), friction, strict=True)
    }
    for name, sides in {"top": "shank.zmax head.zmin", "thread": "nut.zmax shank.zmin"}.items():
        tables["interface"][name] = {"sides": sides.split(), "behaviour": "perfect"}
    # strains of 1e-5
    strain = 1e-5 * min(_speed(s) ** 2 * s["density"] for s in stuffs)
    force = strain * 0.2 * reach * width * rng.uniform(0.3, 1.0)
    step = float(2.0 * size / max(_speed(s) for s in stuffs) * rng.uniform(0.05, 0.3))
    tables |= {
        "bolt": {"b": {"substructure": "shank", "axis": [0.0, 0.0, 1.0], "force": float(force)}},
        "boundary": {"wall": {"type": "fixed", "face": "lower.xmin"}},
        "sensor": {"tip": {"face": "upper.xmax"}, "top": {"face": "head.zmax"}},
        "load": {},
        "time": {"end": INSTANTS * step, "instants": INSTANTS, "scheme": SCHEMES[int(rng.integers(len(SCHEMES)))]},
        "solver": {"tolerance": 1e-9, "max_iterations": 1000},
        "output": {"energy": True, "fields": False, "reactions": True},
    }
    share = force / (length * width)
    if rng.random() < 0.5:
        pressure = float(share * rng.uniform(0.2, 1.0))
        tables["load"]["press"] = {"face": "upper.zmax", "pressure": pressure, "law": _law(rng, INSTANTS * step)}
    else:
        traction = (0.3 * share * rng.normal(size=3)).tolist()
        tables["load"]["push"] = {"face": "upper.xmax", "traction": traction, "law": _law(rng, INSTANTS * step)}
    if rng.random() < 0.3:
        hot = [str(rng.choice(list(bodies)))]
        tables["temperature"] = {"hot": {"substructures": hot, "change": float(rng.uniform(-0.3, 0.3))}}
    return tables


def row_scene(seed: int) -> Tables:
    """A scene of two or three boxes in a row along z, b0 at the bottom, as tables."""
    rng = np.random.default_rng(seed)
    count, size = 2 + int(rng.random() < 0.3), 10.0 ** rng.uniform(-2.0, -0.5)
    stuffs = [_stuff(rng) for _ in range(count)]
    tables: Tables = {"name": f"relation_{seed}", "material": {}, "substructure": {}, "interface": {}}
    tables |= {key: {} for key in ("boundary", "load", "sensor", "temperature", "spring", "point_mass")}
    static = rng.random() < 0.35
    _bodies(tables, rng, stuffs, size)
    step = _step(tables, stuffs) * 10.0 ** rng.uniform(-0.3, 0.6)
    closes = size * 1e-6
    for i in range(1, count):
        tables["interface"][f"i{i}"] = {
            "sides": [f"b{i - 1}.zmax", f"b{i}.zmin"],
            **_joint(rng, stuffs[i], size, static, closes),
        }
    _support(tables, rng, static, count)
    _loads(tables, rng, stuffs, count, INSTANTS * step)
    speed = min(_speed(s) for s in stuffs) * 1e-5
    _motions(tables, rng, count, static, speed)
    if rng.random() < 0.3 or static:
        _heat(tables, rng, count)
    if rng.random() < 0.2:
        _attachments(tables, rng, stuffs, size)
    tables["time"] = {"end": INSTANTS * step, "instants": INSTANTS, "scheme": SCHEMES[int(rng.integers(len(SCHEMES)))]}
    if static:
        tables["time"]["start"] = "static"
    tables["solver"] = {"tolerance": 1e-9, "max_iterations": 1000}
    tables["output"] = {"energy": True, "fields": False, "reactions": True}
    return tables


def _speed(stuff: Tables) -> float:
    modulus = stuff.get("young_modulus") or max(stuff["orthotropic"]["young_moduli"])
    return float(np.sqrt(modulus / stuff["density"]))


def _stuff(rng: Random) -> Tables:
    modulus, density = 10.0 ** rng.uniform(9.5, 11.3), rng.uniform(1000.0, 9000.0)
    stuff: Tables = {"density": density}
    if rng.random() < 0.2:
        stuff["orthotropic"] = {
            "young_moduli": [modulus * f for f in rng.uniform(0.6, 1.4, 3)],
            "poisson_ratios": rng.uniform(0.1, 0.3, 3).tolist(),
            "shear_moduli": [0.4 * modulus * f for f in rng.uniform(0.8, 1.2, 3)],
            "thermal_expansions": (1e-5 * rng.uniform(0.5, 2.0, 3)).tolist(),
            "axes": {"x": rng.normal(size=3).tolist(), "y": rng.normal(size=3).tolist()},
        }
    else:
        stuff |= {
            "young_modulus": modulus,
            "poisson_ratio": float(rng.choice([0.0, 0.2, 0.3, 0.4])),
            "thermal_expansion": float(1e-5 * rng.uniform(0.5, 2.0)),
        }
    if rng.random() < 0.3:
        stuff["rayleigh_stiffness"] = float(10.0 ** rng.uniform(-8, -6))
    return stuff


def _bodies(tables: Tables, rng: Random, stuffs: list[Tables], size: float) -> None:
    """Boxes whose faces overlap in part, with meshes of their own; a sensor in each."""
    level = 0.0
    alike = rng.random() < 0.25  # the same boxes, displaced: meshes match or sides are alike
    first = size * rng.uniform(0.5, 1.5, 3), [int(n) for n in rng.integers(1, 4, 3)]
    for i, stuff in enumerate(stuffs):
        edges, elements = first if alike else (size * rng.uniform(0.5, 1.5, 3), [int(n) for n in rng.integers(1, 4, 3)])
        origin = [*(size * rng.uniform(-0.15, 0.15, 2) * (not alike or rng.random() < 0.5)), level]
        tables["material"][f"m{i}"] = stuffs[0] if alike else stuff
        tables["substructure"][f"b{i}"] = {
            "material": f"m{i}",
            "box": {"origin": [float(x) for x in origin], "size": edges.tolist(), "elements": elements},
        }
        inside = np.add(origin, edges * rng.uniform(0.1, 0.9, 3))
        tables["sensor"][f"s{i}"] = {"substructure": f"b{i}", "point": inside.tolist()}
        level += float(edges[2])
    tables["sensor"]["top"] = {"face": f"b{len(stuffs) - 1}.zmax"}


def _step(tables: Tables, stuffs: list[Tables]) -> float:
    """Time a wave takes to cross an element, the longest of all bodies along z."""
    boxes = [body["box"] for body in tables["substructure"].values()]
    return max(box["size"][2] / box["elements"][2] / _speed(s) for box, s in zip(boxes, stuffs, strict=True))


def _joint(rng: Random, stuff: Tables, size: float, static: bool, closes: float) -> Tables:
    kind = JOINTS[int(rng.integers(len(JOINTS)))]
    stiffness = _speed(stuff) ** 2 * stuff["density"] / size * 10.0 ** rng.uniform(-0.5, 1.0)
    made: Tables = {"behaviour": kind}
    if kind in ("contact", "soft_contact"):
        made["friction_coefficient"] = float(rng.choice([0.0, 0.1, 0.3, 0.6]))
    if kind in ("elastic_layer", "soft_contact"):
        made["normal_stiffness"] = stiffness
    if kind == "elastic_layer":
        made["tangential_stiffness"] = 0.4 * stiffness
    if kind == "viscous_joint":
        viscosity = _speed(stuff) * stuff["density"] * 10.0 ** rng.uniform(-1.5, 0.5)
        made |= {"normal_viscosity": viscosity, "tangential_viscosity": 0.5 * viscosity}
    if kind in OPENING and rng.random() < 0.4:
        made["gap"] = float(closes * rng.uniform(0.05, 1.0))
    if kind == "contact" and not static and "gap" not in made and rng.random() < 0.2:
        made["preload"] = float(10.0 ** rng.uniform(5, 7))
    return made


def _support(tables: Tables, rng: Random, static: bool, count: int) -> None:
    """What holds the lowest body, or nothing; perhaps planes of symmetry."""
    kind = rng.choice(["fixed", "symmetry", "ground", "driven", "free"], p=[0.4, 0.1, 0.15, 0.2, 0.15])
    kind = "fixed" if static else kind
    if kind in ("fixed", "symmetry"):
        tables["boundary"]["base"] = {"type": str(kind), "face": "b0.zmin"}
    elif kind == "ground":
        friction = float(rng.choice([0.0, 0.3]))
        tables["interface"]["floor"] = {"sides": ["b0.zmin", "ground"], "friction_coefficient": friction}
    elif kind == "driven":
        size = tables["substructure"]["b0"]["box"]["size"][0]
        tables["boundary"]["base"] = {
            "type": "displacement",
            "face": "b0.zmin",
            "components": ["x", "y", "z"],
            "value": (1e-6 * size * rng.normal(size=3)).tolist(),
            "law": "driven",
        }
    if rng.random() < 0.2:
        tables["boundary"]["side"] = {"type": "symmetry", "face": "b0.xmin"}
    if count > 2 and rng.random() < 0.1 and not static:
        tables["boundary"]["quiet"] = {"type": "absorbing", "face": f"b{count - 1}.ymin"}


def _law(rng: Random, end: float) -> Tables:
    kind = rng.choice(["half_sine", "table", "step"])
    if kind == "half_sine":
        return {"type": "half_sine", "duration": float(end * rng.uniform(0.3, 0.9))}
    if kind == "step":
        return {"type": "step", "start": 0.0}
    return {"type": "table", "times": [0.0, 0.4 * end, end], "values": [0.0, *rng.normal(size=2).tolist()]}


def _loads(tables: Tables, rng: Random, stuffs: list[Tables], count: int, end: float) -> None:
    """A load or two; the driven face gets its law here, where the end is known."""
    base = tables["boundary"].get("base", {})
    if base.get("law") == "driven":
        base["law"] = {"type": "table", "times": [0.0, end], "values": [0.0, 1.0]}
    box = tables["substructure"][f"b{count - 1}"]["box"]
    strain = 1e-5 * _speed(stuffs[-1]) ** 2 * stuffs[-1]["density"]
    area = box["size"][0] * box["size"][1]
    tables["load"]["press"] = {
        "face": f"b{count - 1}.zmax",
        "pressure": float(strain * rng.uniform(0.3, 2.0)),
        "law": _law(rng, end),
    }
    if rng.random() < 0.5:
        face = str(rng.choice(["xmax", "ymax", "xmin"]))
        tables["load"]["push"] = {
            "face": f"b{count - 1}.{face}",
            "force": (0.3 * strain * area * rng.normal(size=3)).tolist(),
            "law": _law(rng, end),
        }
        if rng.random() < 0.5:
            moment = 0.05 * strain * area * box["size"][0] * rng.normal(size=3)
            tables["load"]["push"]["moment"] = moment.tolist()
    if rng.random() < 0.3:
        tables["gravity"] = {
            "acceleration": (strain / (stuffs[0]["density"] * end * 1e4) * rng.normal(size=3)).tolist()
        }


def _motions(tables: Tables, rng: Random, count: int, static: bool, speed: float) -> None:
    """Velocities of the bodies, or of all of them."""
    for i in range(1, count):
        if not static and rng.random() < 0.4:
            tables["substructure"][f"b{i}"]["initial_velocity"] = (speed * rng.normal(size=3)).tolist()
    if rng.random() < 0.2:
        body = tables["substructure"][f"b{int(rng.integers(count))}"]
        body["body_force"] = (1e-5 * 1e10 / body["box"]["size"][2] * 0.1 * rng.normal(size=3)).tolist()
    if static:
        # nothing pulls bodies apart that contacts hold
        tables.pop("gravity", None)
        for name, body in tables["substructure"].items():
            if name != "b0":
                body.pop("body_force", None)


def _heat(tables: Tables, rng: Random, count: int) -> None:
    names = [f"b{i}" for i in range(count) if rng.random() < 0.7] or ["b0"]
    # heated bodies start in equilibrium, from which they cannot be in motion
    for body in tables["substructure"].values():
        body.pop("initial_velocity", None)
    tables["temperature"]["hot"] = {"substructures": names, "change": float(rng.uniform(-3.0, 3.0))}


def _attachments(tables: Tables, rng: Random, stuffs: list[Tables], size: float) -> None:
    """A spring between two bodies, or a mass on one."""
    place = tables["sensor"]
    if rng.random() < 0.5:
        stiffness = size * _speed(stuffs[0]) ** 2 * stuffs[0]["density"] * rng.uniform(0.01, 0.1)
        ends = [{k: place[s][k] for k in ("substructure", "point")} for s in ("s0", "s1")]
        tables["spring"]["hold"] = {"ends": ends, "stiffness": float(stiffness)}
    else:
        body = tables["substructure"]["b0"]["box"]
        mass = float(np.prod(body["size"]) * stuffs[0]["density"] * rng.uniform(0.05, 0.3))
        tables["point_mass"]["lump"] = {k: place["s0"][k] for k in ("substructure", "point")} | {"mass": mass}
