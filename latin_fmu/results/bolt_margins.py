"""Stresses on the sections of bolts and margins of screws by VDI 2230-1:2015, from the histories of a run.

The forces are computed ones: the largest of the run in the place of F_Smax, half the largest range of the stress at the
edge in the place of sigma_ab, the normal and the tangential resultant at the points of an interface that are nearest to
the screw in the place of F_KR and F_Q. Clauses are steps and equations of that guideline. A moment about the axis of
the screw that a face transmits is left out of slip.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Final

import numpy as np

from ..latin.bolt_sections import THREAD, ClampedFace, ScrewData
from ..latin.outcome import Array, BoltHistory, InterfaceHistory
from .bolt_strength import UTILISATION, assembly_torsion, endurance, permissible_preload, service_stress, stress_area
from .groups import finite

CHECKS: Final[Mapping[str, tuple[str, str]]] = {
    "assembly_yield": ("R7/3", "assembly"),
    "service_yield": ("R8/5-2", "yield"),
    "edge_yield": ("R8/5-2 and bending", "and bending"),
    "fatigue": ("R9/4", "fatigue"),
    "pressure_head": ("R10/4", "under head"),
    "pressure_nut": ("R10/4", "under nut"),
    "slip": ("R12/4", "slip"),
    "separation": ("R12/1", "clamp left"),
}
"""Checks by key: clause, and head of its column."""
_ANGLES: Final = 72  # points around the edge of a section
_SHEARED: Final = 1e-6  # of the largest clamp force: less shear is round-off


@dataclass(frozen=True)
class BoltMargin:
    """A check of a screw.

    Attributes
    ----------
    check : key of ``CHECKS``. value, limit : what acts, and what is allowed, Pa or N. safety : limit over value; of
        ``separation`` the smallest clamp force over that at the start. note : what it is of, in words.
    """

    check: str
    value: float
    limit: float
    safety: float
    note: str = ""

    @property
    def clause(self) -> str:
        """Step and equation of VDI 2230-1:2015."""
        return CHECKS[self.check][0]

    def report(self) -> dict[str, float | str | None]:
        """The check as plain data, for JSON."""
        numbers = {name: finite(getattr(self, name)) for name in ("value", "limit", "safety")}
        return {"clause": self.clause, **numbers, "note": self.note}


@dataclass(frozen=True)
class SectionStresses:
    """Stresses on the sections of a shank, over the stress area of its thread, else over the mesh.

    Attributes
    ----------
    bolt : its history.
    """

    bolt: BoltHistory

    @cached_property
    def _diameters(self) -> Array:
        """(n_section,) of a circle of the section, m."""
        assert self.bolt.sections is not None
        areas = self.bolt.sections.areas / self.bolt.share
        if self.bolt.thread_area is not None:
            areas = np.full(len(areas), self.bolt.thread_area)
        return np.asarray(np.sqrt(4.0 / np.pi * areas))

    @property
    def whole(self) -> bool:
        """Whether the whole screw is modelled: the moments of a part of it are none of the whole."""
        return self.bolt.share == 1.0

    @cached_property
    def nominal(self) -> Array | None:
        """N / A, (n_time, n_section), Pa; None without sections."""
        if self.bolt.sections is None or self.bolt.section_force is None:
            return None
        return np.asarray(self.bolt.section_force[..., 0] / (0.25 * np.pi * self.bolt.share * self._diameters**2))

    @cached_property
    def bending(self) -> Array | None:
        """|M| / W, (n_time, n_section), Pa; None without sections, and of a screw cut by symmetry."""
        if self.nominal is None or self.bolt.section_moment is None or not self.whole:
            return None
        size = np.linalg.norm(self.bolt.section_moment[..., 1:], axis=-1)
        return np.asarray(size / (np.pi / 32.0 * self._diameters**3))

    @property
    def edge(self) -> Array | None:
        """Largest axial stress at the edge of each section, (n_time, n_section), Pa."""
        if self.nominal is None or self.bending is None:
            return self.nominal
        return self.nominal + self.bending

    def amplitude(self, section: int) -> float:
        """Half the largest range of the axial stress at a point of the edge of a section, Pa."""
        assert self.nominal is not None
        stress = self.nominal[:, section, None]
        if self.bending is not None and self.bolt.section_moment is not None:
            angles = np.linspace(0.0, 2.0 * np.pi, _ANGLES, endpoint=False)
            moment = self.bolt.section_moment[:, section, 1:] / (np.pi / 32.0 * self._diameters[section] ** 3)
            # a moment about the first direction pulls where the second one points, at 90 degrees
            stress = stress + moment[:, :1] * np.sin(angles) - moment[:, 1:] * np.cos(angles)
        return float(0.5 * np.ptp(stress, axis=0).max())


@dataclass(frozen=True)
class BoltMargins:
    """Margins of a bolt by check, and what could not be checked, a sentence each."""

    margins: Mapping[str, BoltMargin]
    missing: tuple[str, ...]

    @classmethod
    def of(cls, bolt: BoltHistory, interfaces: Mapping[str, InterfaceHistory]) -> BoltMargins:
        """Of a bolt and the interfaces of its run."""
        missing = list[str]()
        found = [*_clamped(bolt, interfaces, missing)]
        if bolt.screw is None:
            missing.append("no yield, no fatigue: give the thread of the bolt")
        elif len(bolt.force):
            found = [*_strength(bolt, bolt.screw, missing), *found]
        return cls({margin.check: margin for margin in found}, tuple(missing))

    @property
    def smallest(self) -> BoltMargin | None:
        """The check with the smallest safety, without that of separation, whose safety is a share."""
        among = [m for name, m in self.margins.items() if name != "separation" and math.isfinite(m.safety)]
        return min(among, key=lambda m: m.safety, default=None)


def _strength(bolt: BoltHistory, screw: ScrewData, missing: list[str]) -> Iterator[BoltMargin]:
    """Checks of the screw itself."""
    stresses, tight = SectionStresses(bolt), max(bolt.tightening, default=bolt.force[0]) / bolt.share
    largest = float(bolt.force.max()) / bolt.share
    if bolt.section_force is not None and bolt.section_force.size:
        largest = max(largest, float(bolt.section_force[..., 0].max()) / bolt.share)
    torsion, friction = assembly_torsion(bolt) or 0.0, screw.thread_friction
    if screw.yield_stress is None:
        missing.append("no margin of yield: give property_class, or the yield_stress of the material")
    else:
        limit, area = screw.yield_stress, stress_area(screw)
        turned = "without torsion, no torque is known" if friction is None else f"thread friction {friction:.3g}"
        allowed = permissible_preload(screw, limit, friction or 0.0)
        if friction is None:
            allowed = UTILISATION * limit * area
        yield BoltMargin("assembly_yield", tight, allowed, allowed / tight if tight > 0.0 else math.inf, turned)
        stress = service_stress(screw, largest, torsion)
        yield BoltMargin("service_yield", stress, limit, limit / stress, "half the torsion of assembly")
        if stresses.edge is not None and stresses.bending is not None and bolt.sections is not None:
            instant, section = np.unravel_index(int(np.argmax(stresses.edge)), stresses.edge.shape)
            bent = float(stresses.bending[instant, section])
            force = float(stresses.edge[instant, section] - bent) * area
            stress = service_stress(screw, force, torsion, bent)
            yield BoltMargin("edge_yield", stress, limit, limit / stress, f"at {bolt.sections.names[section]}")
    if stresses.nominal is not None and bolt.sections is not None:
        yield _fatigue(bolt, screw, stresses, bolt.sections.number(THREAD))
    for end, area_under in (("head", screw.head), ("nut", screw.nut)):
        if area_under is None:
            why = "no seat was found" if end == "head" else "no seat of a nut was found, and a tapped hole has none"
            missing.append(f"no pressure under the {end}: {why}; else give {end}_bearing")
            continue
        pressure, permitted = max(largest, tight) / area_under, screw.permissible_pressure
        if permitted is None:
            missing.append(f"no margin of the pressure under the {end}: give permissible_pressure")
            permitted = math.nan
        yield BoltMargin(f"pressure_{end}", pressure, permitted, permitted / pressure)


def _fatigue(bolt: BoltHistory, screw: ScrewData, stresses: SectionStresses, section: int) -> BoltMargin:
    """Amplitude at the first engaged thread, as if it were repeated more than 2e6 times."""
    assert bolt.sections is not None
    assert bolt.section_force is not None
    amplitude = stresses.amplitude(section)
    along = bolt.section_force[:, section, 0] / bolt.share
    limit = endurance(screw, 0.5 * float(along.max() + along.min()))
    note = f"at {bolt.sections.names[section]}, rolled {screw.rolled} heat treatment"
    if not stresses.whole:
        note += ", without bending: a part of the screw is modelled"
    return BoltMargin("fatigue", amplitude, limit, limit / amplitude if amplitude > 0.0 else math.inf, note)


# -- clamped parts ----------------------------------------------------------------------------------------------------
def _clamped(bolt: BoltHistory, interfaces: Mapping[str, InterfaceHistory], missing: list[str]) -> Iterator[BoltMargin]:
    """Checks of the faces that the bolt clamps: slip by the smallest of their frictions, separation."""
    known = [(face, interfaces[face.interface]) for face in bolt.clamped if face.interface in interfaces]
    frictions = [face.friction for face in bolt.clamped if face.friction is not None]
    slips, clamps = list[tuple[float, float, float, str]](), list[tuple[float, float, float, str]]()
    for face, history in known:
        clamp, shear = _carried(face, history)
        first, least = float(clamp[0]), float(clamp.min(initial=np.inf))
        if first > 0.0:
            clamps.append((least / first, first, least, face.interface))
        sheared = shear > _SHEARED * float(np.abs(clamp).max(initial=0.0))
        if frictions and face.friction is not None and sheared.any():
            ratio = min(frictions) * np.maximum(clamp, 0.0)[sheared] / shear[sheared]
            i = int(np.argmin(ratio))
            slips.append((float(ratio[i]), float(shear[sheared][i]), float(clamp[sheared][i]), face.interface))
    if not bolt.clamped:
        missing.append("no slip, no separation: no face of clamped parts surrounds the shank")
    elif not frictions:
        missing.append("no slip: the faces that it clamps are bonded")
    if slips:
        safety, shear_then, clamp_then, name = min(slips)
        note = f"{name}, friction {min(frictions):.3g}, clamp force and shear of its points around the shank"
        yield BoltMargin("slip", shear_then, min(frictions) * clamp_then, safety, note)
    if clamps:
        share, first, least, name = min(clamps)
        yield BoltMargin("separation", first, least, share, f"{name}, clamp force of its points around the shank")
    elif bolt.clamped and bolt.force[0] > 0.0:
        least = float(bolt.force.min())
        yield BoltMargin("separation", float(bolt.force[0]), least, least / float(bolt.force[0]), "by its tension")


def _carried(face: ClampedFace, history: InterfaceHistory) -> tuple[Array, Array]:
    """Normal resultant in compression, and size of the tangential one, (n_time,) each, N, of the points of a face."""
    normals, areas = history.normals[face.points], history.areas[face.points]
    forces = history.traction[:, face.points] * areas[:, None]
    along = np.einsum("tpc,pc->tp", forces, normals)
    aside = (forces - along[..., None] * normals).sum(axis=1)
    return -along.sum(axis=1), np.asarray(np.linalg.norm(aside, axis=1))
