"""What most scripts take from a results file: resultants, maps of pressure, skins of bodies, spectra and ring-downs of
sensors.

The functions take the DataTree of ``open_results`` or ``Solution.to_datatree`` and return xarray objects with units.
Maps and skins are UGRID meshes that ``xugrid.UgridDataset`` opens and plots.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..errors import InputError, Problem
from ..fem.mesh import Mesh, boundary, cell_blocks
from ..shock.oscillators import RESPONSES
from .files import readable
from .filters import uniform_step
from .groups import unit_of, units_of
from .interface_fields import InterfaceFields, friction_resultant, normal_resultant
from .spectra import LINES, shock_response_spectrum

if TYPE_CHECKING:
    import xarray as xr

Array = NDArray[np.float64]

_WEAK: Final = 0.05  # of the largest amplitude of a vibration


def resultant(tree: xr.DataTree, interface: str) -> xr.Dataset:
    """Force of an interface over time: ``force`` (time, component) on its first side, ``normal`` (time), positive in
    compression, and ``friction`` (time), the magnitude of the tangential resultant; N.

    Raises InputError where there is no such interface.

    Examples
    --------
    >>> tree = latin_fmu.solve(latin_fmu.load_scene("models/impact_bar/scene.toml")).to_datatree()
    >>> latin_fmu.resultant(tree, "wall")["normal"].sizes["time"]
    401
    """
    group = _group(tree, "interfaces", interface)
    with readable(_source(tree)):
        fields = InterfaceFields.of_dataset(group)
        forces = group[["force"]]
    for name, values, text in (
        ("normal", normal_resultant(fields), "normal resultant, positive in compression"),
        ("friction", friction_resultant(fields), "magnitude of the tangential resultant"),
    ):
        forces[name] = ("time", values, {"units": unit_of(forces["force"], "N"), "long_name": text})
    return forces


def pressure_map(tree: xr.DataTree, interface: str, time: float | None = None) -> xr.Dataset:
    """Contact pressure of an interface as a UGRID mesh in its mean plane: ``pressure`` (point), Pa, and ``area``.

    time : the stored instant nearest to it is taken, s; that with the largest normal force where None.

    Raises InputError where there is no such interface, or its points carry no cells.

    Examples
    --------
    >>> solution = latin_fmu.solve(latin_fmu.load_scene("models/two_specimen_crushing/scene.toml"))
    >>> pressure = latin_fmu.pressure_map(solution.to_datatree(), "crush")
    >>> pressure["pressure"].dims, pressure["pressure"].attrs["units"]
    (('point',), 'Pa')
    """
    group = _group(tree, "interfaces", interface)
    if "cells" not in group:
        what = "has no surface: its points carry no cells"
        raise InputError([Problem(f"interface {interface}", what)], "there is no map")
    with readable(_source(tree)):
        fields = InterfaceFields.of_dataset(group)
    if time is None:
        at = int(normal_resultant(fields).argmax())
    else:
        at = int(np.abs(fields.time - time).argmin())
    pressure = -np.einsum("pc,pc->p", fields.traction[at], fields.normals) + 0.0  # no negative zero
    attrs = {
        "units": unit_of(group["traction"], "Pa"),
        "long_name": "contact pressure",
        "mesh": "surface",
        "location": "node",
    }
    pressures = group[["surface", "cells", "area"]]
    if (pressures["cells"].values < 0).any():
        # readers of UGRID need it where cells differ in their number of nodes
        pressures["cells"] = pressures["cells"].assign_attrs({"_FillValue": pressures["cells"].dtype.type(-1)})
    pressures["pressure"] = ("point", pressure, attrs)
    return pressures.assign_attrs(time=float(fields.time[at]))


def skin(tree: xr.DataTree, substructure: str) -> xr.Dataset:
    """Outer surface of a body as a UGRID mesh of faces, projected along z: node_x, node_y, node_z (node), m, ``faces``
    (face, corner), and the fields at its nodes that the file holds, e.g. ``velocity`` (time, node, component).

    Raises InputError where no field of this substructure is in the file (``output.fields = true``).

    Examples
    --------
    >>> scene = latin_fmu.load_scene("models/impact_bar/scene.toml", ["output.fields=true"])
    >>> surface = latin_fmu.skin(latin_fmu.solve(scene).to_datatree(), "bar")
    >>> surface["faces"].dims
    ('face', 'corner')
    """
    group = _group(tree, "substructures", substructure, "store fields: output.fields = true")
    with readable(_source(tree)):
        nodes = np.stack([group[f"node_{axis}"].values for axis in "xyz"], axis=1)
        tables = [block.corners for block in boundary(Mesh(nodes, cell_blocks(group["cell_nodes"].values), {})).blocks]
    corners = np.full((sum(map(len, tables)), max(t.shape[1] for t in tables)), -1, dtype=np.int64)
    row = 0
    for table in tables:
        corners[row : row + len(table), : table.shape[1]] = table
        row += len(table)
    # -1 fills the rows of triangles beside quadrilaterals
    used, numbers = np.unique(corners[corners >= 0], return_inverse=True)
    corners[corners >= 0] = numbers
    fields = [str(name) for name, v in group.data_vars.items() if "node" in v.dims]
    surface = group[fields].isel(node=used).drop_attrs(deep=False)
    for name in fields:
        surface[name].attrs.update(mesh="skin", location="node")
    connectivity = {
        "cf_role": "face_node_connectivity",
        "start_index": np.int32(0),
        "long_name": "corners of the faces",
    }
    surface["faces"] = (("face", "corner"), corners, connectivity | {"_FillValue": np.int64(-1)})
    surface["skin"] = (
        (),
        np.int32(0),
        {
            "cf_role": "mesh_topology",
            "topology_dimension": np.int32(2),
            "node_coordinates": "node_x node_y",
            "face_node_connectivity": "faces",
            "node_dimension": "node",
            "face_dimension": "face",
            "long_name": f"skin of {substructure}, in the plane of x and y",
        },
    )
    return surface


def sensor_spectrum(tree: xr.DataTree, sensor: str, frequencies: ArrayLike, quality: float = 10.0) -> xr.Dataset:
    """Shock response spectrum of the stored acceleration of a sensor: ``acceleration`` (response, frequency,
    component), m s-2, and ``pseudo_velocity``, m s-1; see ``shock_response_spectrum``.

    Raises InputError where there is no such sensor, or as ``shock_response_spectrum``.

    Examples
    --------
    >>> scene = latin_fmu.load_scene("models/lap_joint/shock.toml", ["time.end=50e-6"])
    >>> tree = latin_fmu.solve(scene).to_datatree()
    >>> latin_fmu.sensor_spectrum(tree, "end", [20e3, 50e3])["acceleration"].dims
    ('response', 'frequency', 'component')
    """
    import xarray as xr

    history = _history(tree, sensor, "acceleration")
    step = float(history["time"][1] - history["time"][0])
    spectrum = shock_response_spectrum(history.values, step, frequencies, quality, interpolation=LINES)
    dims = ("response", "frequency", "component")
    label = units_of(tree.attrs).label
    hertz = {"units": "Hz", "long_name": "natural frequency of the oscillator"}
    return xr.Dataset(
        {
            "acceleration": (
                dims,
                spectrum.acceleration,
                {"units": label("m s-2"), "long_name": "largest acceleration"},
            ),
            "pseudo_velocity": (
                dims,
                spectrum.pseudo_velocity,
                {"units": label("m s-1"), "long_name": "largest pseudo-velocity"},
            ),
        },
        {
            "response": np.array(RESPONSES, dtype=object),
            "frequency": ("frequency", spectrum.frequency, hertz),
            "component": history["component"].values,
        },
        {"quality": quality, "interpolation": spectrum.interpolation},
    )


def amplitude_spectrum(tree: xr.DataTree, sensor: str, quantity: str = "acceleration") -> xr.DataArray:
    """Amplitudes (frequency, component) of the harmonics of a history of a sensor, its mean at 0 Hz:

        A_k = (2 / n) |sum over j of x_j exp(-2 pi i j k / n)|,    without the factor 2 at k = 0 and at n / 2.

    The n instants are one period, without window function; unit of the history.

    Raises InputError where there is no such sensor or quantity.

    Examples
    --------
    >>> scene = latin_fmu.load_scene("models/gripped_bar/scene.toml")
    >>> tree = latin_fmu.solve(scene).to_datatree()
    >>> latin_fmu.amplitude_spectrum(tree, "end", "displacement").dims
    ('frequency', 'component')
    """
    history = _history(tree, sensor, quantity)
    n, step = len(history), float(history["time"][1] - history["time"][0])
    amplitude = np.abs(np.fft.rfft(history.values, axis=0)) * (2.0 / n)
    # the mean and, of an even number, half the sampling rate have no mirror image
    amplitude[0] *= 0.5
    if n % 2 == 0:
        amplitude[-1] *= 0.5
    coords = {"frequency": ("frequency", np.fft.rfftfreq(n, step), {"units": "Hz", "long_name": "frequency"})}
    template = history.drop_vars("time").rename(time="frequency").isel(frequency=slice(len(amplitude)))
    return template.copy(data=amplitude).assign_coords(coords)


def ring_down(
    tree: xr.DataTree,
    sensor: str,
    band: tuple[float, float],
    direction: ArrayLike | None = None,
    *,
    periods: int = 6,
    quantity: str = "displacement",
    without_slip: xr.DataTree | None = None,
) -> xr.Dataset:
    """Frequency and damping of a free vibration against its amplitude: ``amplitude``, ``frequency``, Hz, ``damping``
    (share of critical) over ``time``, s, with ``frequency_error`` and ``damping_error``, one standard deviation.

    The motion along one direction goes forwards and backwards through a Butterworth band-pass of order 3, which leaves
    its phase; a exp(i theta) is its analytic signal (Feldman, Mech. Syst. Signal Process. 25 (2011) 735). Lines through
    theta and ln a over windows of so many periods have the slopes omega_d and -zeta omega, so that

        zeta omega / omega_d = zeta / sqrt(1 - zeta^2),    omega = omega_d / sqrt(1 - zeta^2).

    The errors are those of the slopes for one independent residual a period. Left out are both ends of the record, over
    the memory of the filter (3 / width of the band), and what follows after the amplitude has fallen below a twentieth
    of its largest.

    Parameters
    ----------
    band : lowest and highest frequency, Hz, around that of the mode, 0 < lowest < highest < half the sampling rate.
    direction : (3,); that in which the filtered motion is largest where None.
    periods : of a window; windows overlap by half. quantity : displacement, velocity or acceleration.
    without_slip : the same run with joints that cannot slide: the damping of time scheme and iteration, the median of
        what is found in it, becomes the attribute ``floor``.

    Raises InputError where there is no such sensor, or the record is too short or uneven.

    Examples
    --------
    >>> import xarray as xr
    >>> time = np.arange(0.0, 2.0, 1e-3)
    >>> moved = 1e-3 * np.exp(-0.01 * 2 * np.pi * 50 * time) * np.cos(2 * np.pi * 50 * time)
    >>> history = (("time", "component"), moved[:, None] * [0.0, 0.0, 1.0])
    >>> sensor = xr.Dataset({"displacement": history}, {"time": time, "component": list("xyz")})
    >>> decay = latin_fmu.ring_down(xr.DataTree.from_dict({"/sensors/tip": sensor}), "tip", (30.0, 80.0))
    >>> decay["damping"].values[2].round(3)
    np.float64(0.01)
    """
    import xarray as xr

    history = _history(tree, sensor, quantity)
    _check_arguments(periods, direction)
    time = np.asarray(history["time"].values, dtype=float)
    motion = _in_band(sensor, history.values, time, band)
    remembered = 3 / (band[1] - band[0])
    inside = (time >= time[0] + remembered) & (time <= time[-1] - remembered)
    if direction is None:
        # the principal direction of the motion
        axis = np.linalg.svd(motion[inside], full_matrices=False)[2][0]
    else:
        axis = np.asarray(direction, dtype=float) / np.linalg.norm(np.asarray(direction, dtype=float))
    # of the whole record: its ends, where the transform is bad, are cut off then
    signal = _analytic(motion @ axis)[inside]
    # from there on the transient of filter and transform after the large start counts
    weak = np.flatnonzero(np.abs(signal) < _WEAK * np.abs(signal).max(initial=0.0))
    time = time[inside]
    if weak.size:
        signal, time = signal[: weak[0]], time[: weak[0]]
    theta, log_size = np.unwrap(np.angle(signal)), np.log(np.abs(signal))
    if len(time) > 2:
        period = 2 * np.pi * (time[1] - time[0]) / float(np.median(np.diff(theta)))
    else:
        period = np.inf
    length, span = len(time), "0 s"
    if np.isfinite(period):
        length = round(periods * period / (time[1] - time[0]))
    if not 2 < length <= len(time):
        what, wanted = "is too short for a window", f"{periods} periods without both ends, which the filter distorts"
        if len(time):
            span = f"{time[-1] - time[0]:.4g} s"
        raise InputError([Problem(f"sensor {sensor}", what, span, wanted)], "no ring-down")
    rows = []
    for start in range(0, len(time) - length + 1, max(length // 2, 1)):
        t, angle, decay = (values[start : start + length] for values in (time, theta, log_size))
        (turn, turn_off), (fall, fall_off) = _line(t, angle, periods), _line(t, decay, periods)
        omega, a = float(np.hypot(turn, fall)), float(np.exp(decay.mean()))
        off = turn_off / (2 * np.pi), fall_off / omega
        rows.append((t.mean(), a, omega / (2 * np.pi), -fall / omega, *off))
    at, amplitude, frequency, damping, *errors = np.array(rows).T
    unit = history.attrs.get("units", "")
    words = "of the windows before and behind the time"
    decay_table = xr.Dataset(
        {
            "amplitude": ("time", amplitude, {"units": unit, "long_name": f"geometric mean amplitude {words}"}),
            "frequency": ("time", frequency, {"units": "Hz", "long_name": "natural frequency"}),
            "damping": ("time", damping, {"units": "1", "long_name": "damping ratio"}),
            "frequency_error": ("time", errors[0], {"units": "Hz", "long_name": "standard deviation of the frequency"}),
            "damping_error": ("time", errors[1], {"units": "1", "long_name": "standard deviation of the damping"}),
        },
        {"time": ("time", at, {"units": "s", "long_name": "middle of the window"})},
        {"sensor": sensor, "direction": axis, "band": np.asarray(band, dtype=float), "periods": periods},
    )
    if without_slip is not None:
        still = ring_down(without_slip, sensor, band, axis, periods=periods, quantity=quantity)
        decay_table.attrs["floor"] = float(np.median(still["damping"]))
    return decay_table


def _check_arguments(periods: int, direction: ArrayLike | None) -> None:
    """Refuse windows and directions that ``ring_down`` cannot work with."""
    problems = []
    if periods < 3:
        problems.append(Problem("periods", "too few for an error", str(periods), "3 or more"))
    if direction is not None and (
        np.shape(direction) != (3,) or not 0 < np.linalg.norm(np.asarray(direction)) < np.inf
    ):
        problems.append(Problem("direction", "no direction", str(direction), "three numbers, not all 0"))
    if problems:
        raise InputError(problems, "no ring-down")


def _in_band(sensor: str, values: Array, time: Array, band: tuple[float, float]) -> Array:
    """Values (n_time, 3) behind the band-pass of ``ring_down``."""
    from scipy.signal import butter, sosfiltfilt

    step = uniform_step(time)
    problems = []
    if not step:
        problems.append(Problem(f"sensor {sensor}", "the steps of the run are of unequal length"))
    low, high = (float(f) for f in band)
    if step and not 0 < low < high < 0.5 / step:
        problems.append(
            Problem("band", "out of range", f"{low:g}, {high:g}", f"0 < lowest < highest < {0.5 / step:g} Hz")
        )
    # 3 / width are left out at each end: 2 / width remain
    if step and not problems and time[-1] - time[0] < 8 / (high - low):
        what, wanted = "the record is too short for this band", f"8 / width = {8 / (high - low):.4g} s or more"
        problems.append(Problem(f"sensor {sensor}", what, f"{time[-1] - time[0]:.4g} s", wanted))
    if problems:
        raise InputError(problems, "no ring-down")
    sections = butter(3, (low, high), btype="bandpass", fs=1 / step, output="sos")
    beyond = min(len(values) - 1, int(np.ceil(3 / ((high - low) * step))))
    return np.asarray(sosfiltfilt(sections, values - values.mean(axis=0), axis=0, padlen=beyond))


def _analytic(values: Array) -> NDArray[np.complex128]:
    """Analytic signal (n,) of real values, zeros behind their end: the transform is periodic."""
    from scipy.signal import hilbert

    return np.asarray(hilbert(values, 2 * len(values)))[: len(values)]


def _line(t: Array, y: Array, independent: int) -> tuple[float, float]:
    """Slope of the line through (t, y), and its standard deviation for so many independent residuals."""
    centred = t - t.mean()
    slope = float(centred @ y / (centred @ centred))
    rest = y - y.mean() - slope * centred
    # two of the residuals go into the line
    return slope, float(np.sqrt((rest @ rest) / len(t) / max(independent - 2, 1) / (centred @ centred / len(t))))


def _history(tree: xr.DataTree, sensor: str, quantity: str) -> xr.DataArray:
    group = _group(tree, "sensors", sensor)
    if quantity not in group or group[quantity].dims != ("time", "component") or len(group["time"]) < 2:
        allowed = ", ".join(str(n) for n, v in group.data_vars.items() if v.dims == ("time", "component"))
        raise InputError([Problem(f"sensor {sensor}", "has no such history", quantity, allowed or "none")])
    return group[quantity]


def _source(tree: xr.DataTree) -> str:
    """Name of the file of a tree, for errors."""
    return str(tree.encoding.get("source", "results"))


def _group(tree: Mapping[str, Any], kind: str, name: str, remedy: str | None = None) -> xr.Dataset:
    """A group of the results as a dataset of its own. Raises InputError where it is missing."""
    groups = {}
    if kind in tree:
        groups = tree[kind].children
    if name not in groups or not groups[name].data_vars:
        there = ", ".join(n for n, group in groups.items() if group.data_vars) or "none"
        raise InputError([Problem(f"{kind}/{name}", "is not in the results", None, there, remedy)])
    dataset: xr.Dataset = groups[name].to_dataset()
    return dataset
