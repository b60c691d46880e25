"""Table [material], by name: elasticity, density and damping of bodies."""

import math
from collections.abc import Iterator
from types import MappingProxyType
from typing import Annotated, Any, Final, Literal, Self

from pydantic import BeforeValidator, model_validator

from ..errors import Problem
from .damping import DampingRatios
from .fields import LocalAxes, Positive, Real, SceneTable, Vector, _as_list, about, refusal
from .raw_scene import given, named_tables
from .strain_damping import StrainDamping

_Moduli = Annotated[tuple[Positive, Positive, Positive], BeforeValidator(_as_list)]


class OrthotropicTable(SceneTable):
    """Nine elastic constants along three axes 1, 2, 3 at right angles, of a laminate, a composite or wood.

    nu_ij is the contraction along j over the extension along i under tension along i; nu_ji = nu_ij E_j / E_i.
    """

    young_moduli: Annotated[_Moduli, about("Young's moduli E_1, E_2, E_3", "Pa")]
    poisson_ratios: Annotated[Vector, about("Poisson's ratios nu_12, nu_13, nu_23", "1")]
    shear_moduli: Annotated[_Moduli, about("shear moduli G_12, G_13, G_23", "Pa")]
    axes: Annotated[LocalAxes | None, about("axes x = 1, y = 2; default: the global axes")] = None
    thermal_expansions: Annotated[
        Vector | None, about("thermal expansion along 1, 2, 3; required where a temperature acts", "K-1")
    ] = None

    @model_validator(mode="after")
    def _check_energy(self) -> Self:
        """Refuse constants with which a strain has no or negative energy (Lempriere 1968)."""
        e, pairs = self.young_moduli, ((0, 1), (0, 2), (1, 2))
        # the compliance scaled to a diagonal of ones: -nu_ij / E_i over 1 / sqrt(E_i E_j)
        a, b, c = (nu * math.sqrt(e[j] / e[i]) for nu, (i, j) in zip(self.poisson_ratios, pairs, strict=True))
        rest = 1.0 - a * a - b * b - c * c - 2.0 * a * b * c
        if max(abs(a), abs(b), abs(c)) < 1.0 and rest > _INDEFINITE:
            return self
        largest = (f"|nu_{i + 1}{j + 1}| < {math.sqrt(e[i] / e[j]):.4g}" for i, j in pairs)
        raise refusal(
            "a strain would have no or negative energy (the compliance is not positive definite)",
            value=f"poisson_ratios {list(self.poisson_ratios)} with young_moduli {list(e)}",
            allowed=f"{', '.join(largest)} and 1 - nu_12 nu_21 - nu_13 nu_31 - nu_23 nu_32 - 2 nu_12 nu_23 nu_31 > 0 "
            f"(here {rest:.3g})",
            remedy="give nu_ij of tension along i and contraction along j, i < j; nu_ji is nu_ij E_j / E_i",
        )


_INDEFINITE: Final = 1e-9  # of the determinant over that of uncoupled axes: below, round-off decides about its sign


class MaterialTable(SceneTable):
    """Homogeneous elastic material, isotropic or orthotropic, with optional damping.

    `damping_ratios` is damping by strain with a ratio over a band; `young_modulus` is the static one. `loss_factor`
    with `at_frequency` is damping by strain as well: a loss factor eta is that of K (1 + i eta) at one frequency f, in
    the time domain b = eta / (2 pi f), a loss that grows with the frequency, eta at f alone (a damping ratio of eta / 2
    there). Rayleigh damping C = a M + b K is for comparisons with other codes: its part a M brakes the absolute
    velocity of everything, driven faces and flying bodies too, as a medium at rest would. Where that matters it is
    refused unless `frame = "absolute"` says that it is meant; with `damping_ratios` that key gives the Rayleigh
    coefficients that have the two ratios.
    """

    young_modulus: Annotated[Real | None, about("Young's modulus E; required without `orthotropic`", "Pa", gt=0)] = None
    poisson_ratio: Annotated[
        Real | None, about("Poisson's ratio nu; required without `orthotropic`", "1", gt=-1, lt=0.5)
    ] = None
    orthotropic: Annotated[OrthotropicTable | None, about("nine constants along three axes instead of E and nu")] = None
    thermal_expansion: Annotated[
        Real | None, about("coefficient of thermal expansion alpha; required where a temperature acts", "K-1")
    ] = None
    density: Annotated[Real, about("mass per unit volume rho", "kg m-3", gt=0)]
    rayleigh_mass: Annotated[
        Real, about("Rayleigh damping, share a of the mass, on the absolute velocity", "s-1", ge=0)
    ] = 0.0
    rayleigh_stiffness: Annotated[Real, about("Rayleigh damping, share b of the stiffness", "s", ge=0)] = 0.0
    damping_ratios: Annotated[DampingRatios | None, about("strain damping, given by ratios over a band")] = None
    frame: Annotated[
        Literal["absolute"] | None,
        about("`absolute`: Rayleigh damping whose mass part brakes velocities against a medium at rest"),
    ] = None
    loss_factor: Annotated[Real | None, about("loss factor eta of the stiffness at `at_frequency`", "1", ge=0)] = None
    at_frequency: Annotated[Real | None, about("frequency at which the loss factor holds", "Hz", gt=0)] = None
    yield_stress: Annotated[
        Real | None,
        about(
            "largest stress of a bolt, at which one with `hardening` yields; a body beyond it gets a remark", "Pa", gt=0
        ),
    ] = None

    @model_validator(mode="after")
    def _check_damping(self) -> Self:
        """Refuse damping that is given twice, and a loss factor without its frequency."""
        if (self.loss_factor is None) != (self.at_frequency is None):
            if self.at_frequency is None:
                missing = "at_frequency"
            else:
                missing = "loss_factor"
            raise refusal(f"loss_factor and at_frequency belong together: {missing!r} is missing", remedy="give both")
        if len(ways := self.damping_keys) > 1 and set(ways) != {"rayleigh_mass", "rayleigh_stiffness"}:
            raise refusal(
                "damping is given twice",
                value=", ".join(ways),
                allowed="rayleigh_mass and rayleigh_stiffness, or damping_ratios, or loss_factor with at_frequency",
            )
        if self.frame is not None and self.damping_ratios is None and not self.rayleigh_mass:
            raise refusal(
                "frame has no effect without rayleigh_mass or damping_ratios", value=self.frame, remedy="omit it"
            )
        return self

    @property
    def young_moduli(self) -> tuple[float, ...]:
        """Young's modulus, of an orthotropic material those along its axes, Pa."""
        if self.orthotropic is not None:
            return self.orthotropic.young_moduli
        assert self.young_modulus is not None, "material_problems"
        return (self.young_modulus,)

    @property
    def damping_keys(self) -> tuple[str, ...]:
        """Keys that give the material its damping."""
        return tuple(key for key in DAMPING_KEYS if getattr(self, key))

    @property
    def drag(self) -> float:
        """Coefficient a of the damping a M, s-1, which acts on absolute velocities."""
        if self.damping_ratios is not None:
            if self.frame:
                return self.damping_ratios.rayleigh[0]
            return 0.0
        return self.rayleigh_mass

    @property
    def damping(self) -> StrainDamping:
        """Damping by strain."""
        if self.damping_ratios is not None:
            if self.frame:
                return StrainDamping(self.damping_ratios.rayleigh[1])
            return self.damping_ratios.damping
        if self.loss_factor is not None and self.at_frequency is not None:
            return StrainDamping(self.loss_factor / (2.0 * math.pi * self.at_frequency))
        return StrainDamping(self.rayleigh_stiffness)


DAMPING_KEYS: Final = ("rayleigh_mass", "rayleigh_stiffness", "damping_ratios", "loss_factor")
"""Keys of a material, each of which makes it lose energy."""


def material_problems(raw: Any) -> Iterator[Problem]:
    """Problems between the keys of the materials of a scene as written."""
    for name, table in named_tables(raw, "material").items():
        both = [key for key in _CONSTANTS if given(table, key)]
        if given(table, "orthotropic"):
            for key in (*both, *(["thermal_expansion"] if given(table, "thermal_expansion") else [])):
                yield Problem(
                    f"material.{name}.{key}",
                    "the constants of an orthotropic material are in its table",
                    remedy=f"leave out {key!r} or 'orthotropic'",
                )
            continue
        for key in (key for key in _CONSTANTS if key not in both):
            yield Problem(
                f"material.{name}.{key}",
                "this key is missing",
                None,
                _CONSTANTS[key],
                "or give the nine constants of [material.NAME.orthotropic]",
            )


_CONSTANTS: Final = MappingProxyType({"young_modulus": "number, > 0 [Pa]", "poisson_ratio": "number, > -1, < 0.5"})
