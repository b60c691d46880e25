"""Table [contact.NAME]: interfaces that the program finds between the boundaries of substructures."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Any

from pydantic import BeforeValidator, create_model

from .fields import Name, Real, Table, _as_list, about
from .interface_keys import PARAMETERS, TAKES
from .interfaces import Behaviour, Gap, Interface

NamePair = Annotated[tuple[Name, Name], BeforeValidator(_as_list)]
NamePairs = Annotated[tuple[NamePair, ...], BeforeValidator(_as_list)]
Names = Annotated[tuple[Name, ...], BeforeValidator(_as_list)]


class _ContactKeys(Table):
    search: Annotated[Real, about("boundaries nearer than this along the normal become an interface", "m", gt=0)]
    parts: Annotated[Names | None, about("substructures among which is searched; all of them where left out")] = None
    behaviour: Annotated[Behaviour, about("what happens there, as for an interface")] = "contact"
    gap: Annotated[Gap | None, about("initial distance, as for an interface", "m")] = None
    friction_coefficient: Annotated[Real, about("Coulomb's coefficient mu", "1", ge=0)] = 0.0
    normal_stiffness: Annotated[Real | None, about("as for an interface", "N m-3", ge=0)] = None
    tangential_stiffness: Annotated[Real | None, about("as for an interface", "N m-3", ge=0)] = None
    normal_viscosity: Annotated[Real | None, about("as for an interface", "N s m-3", ge=0)] = None
    tangential_viscosity: Annotated[Real | None, about("as for an interface", "N s m-3", ge=0)] = None

    @property
    def exceptions(self) -> frozenset[frozenset[str]]:
        """Pairs of substructures that are left out."""
        return frozenset(frozenset(pair) for pair in getattr(self, "except"))

    def interface(self, first: str, second: str) -> Interface:
        """The interface between the boundaries of two substructures."""
        taken = TAKES[self.behaviour]
        keys = [k for k in ("gap", *PARAMETERS) if k in taken and getattr(self, k) is not None]
        values: dict[str, Any] = {key: getattr(self, key) for key in keys}
        return Interface(sides=(f"{first}.*", f"{second}.*"), behaviour=self.behaviour, search=self.search, **values)


if TYPE_CHECKING:

    class ContactSearch(_ContactKeys):
        """Interfaces found between boundaries; a pair with an interface in the scene is left as it is."""
else:
    # "except" is a keyword of Python: such a field cannot be written in the body of a class
    ContactSearch = create_model(
        "ContactSearch",
        __base__=_ContactKeys,
        __doc__="Interfaces found between boundaries; a pair with an interface in the scene is left as it is.",
        **{"except": (Annotated[NamePairs, about("pairs of substructures that are left out")], ())},
    )
