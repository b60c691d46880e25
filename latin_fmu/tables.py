"""Tables of a scene written in Python: one class each, with the keys of the file, their units and ranges.

The keys of a table are its arguments, checked as those of a file are; see the scene reference for their meaning.

>>> from latin_fmu import tables
>>> tables.Material(young_modulus=210e9, poisson_ratio=0.3, density=7800.0).density
7800.0
"""

from .scene.attachments import CouplingTable as Coupling
from .scene.attachments import End, Place, PointMass, Spring
from .scene.bolts import Bolt
from .scene.bolts import ThreadTable as Thread
from .scene.boundaries import (
    Absorbing,
    Fixed,
    Periodic,
    PrescribedAcceleration,
    PrescribedDisplacement,
    PrescribedVelocity,
    Symmetry,
)
from .scene.damping import DampingRatios
from .scene.damping import DampingTable as Damping
from .scene.face_form import Crown, FaceTable, Polynomial
from .scene.fields import LocalAxes
from .scene.initial_fields import DisplacementFile, VelocityFile
from .scene.initial_fields import InitialStateTable as InitialState
from .scene.interfaces import ContactSearch, GroundPlane, GroundVelocity, Interface
from .scene.laws import (
    ConstantLaw,
    CsvLaw,
    HalfSineLaw,
    InputLaw,
    PsdLaw,
    RectangularPulseLaw,
    SrsLaw,
    StepLaw,
    TableLaw,
)
from .scene.limits import Limit
from .scene.loads import Load
from .scene.materials import MaterialTable as Material
from .scene.materials import OrthotropicTable as Orthotropic
from .scene.ports import Port
from .scene.sensors import ChannelClass, LowPass, Sensor, Spectrum
from .scene.settings import (
    Accuracy,
    Automatic,
    AutomaticPropagator,
    AutomaticScheme,
    Diagonal,
    Effects,
    Fmu,
    GivenStart,
    Impedance,
    NoAcceleration,
    OperatorFolder,
    Output,
    Solver,
    StaticStart,
    Time,
    Uniform,
)
from .scene.settings import AndersonTable as Anderson
from .scene.settings import CentralDifferenceTable as CentralDifference
from .scene.settings import CgPropagatorTable as CgPropagator
from .scene.settings import DirectPropagatorTable as DirectPropagator
from .scene.settings import ExplicitPropagatorTable as ExplicitPropagator
from .scene.settings import GeneralizedAlphaTable as GeneralizedAlpha
from .scene.settings import HHTTable as HHT  # noqa: N814, an acronym
from .scene.settings import MasslessContactTable as MasslessContact
from .scene.settings import ModalPropagatorTable as ModalPropagator
from .scene.settings import NewmarkTable as Newmark
from .scene.settings import ReducedPropagatorTable as ReducedPropagator
from .scene.settings import RowTable as Row
from .scene.substructures import BoxTable as Box
from .scene.substructures import Gravity, MeshFile, MeshParts, Motion, Substructure, Temperature
from .scene.substructures import ModalDampingTable as ModalDamping
from .scene.substructures import RotationTable as Rotation

__all__ = [
    "HHT",
    "Absorbing",
    "Accuracy",
    "Anderson",
    "Automatic",
    "AutomaticPropagator",
    "AutomaticScheme",
    "Bolt",
    "Box",
    "CentralDifference",
    "CgPropagator",
    "ChannelClass",
    "ConstantLaw",
    "ContactSearch",
    "Coupling",
    "Crown",
    "CsvLaw",
    "Damping",
    "DampingRatios",
    "Diagonal",
    "DirectPropagator",
    "DisplacementFile",
    "Effects",
    "End",
    "ExplicitPropagator",
    "FaceTable",
    "Fixed",
    "Fmu",
    "GeneralizedAlpha",
    "GivenStart",
    "Gravity",
    "GroundPlane",
    "GroundVelocity",
    "HalfSineLaw",
    "Impedance",
    "InitialState",
    "InputLaw",
    "Interface",
    "Limit",
    "Load",
    "LocalAxes",
    "LowPass",
    "MasslessContact",
    "Material",
    "MeshFile",
    "MeshParts",
    "ModalDamping",
    "ModalPropagator",
    "Motion",
    "Newmark",
    "NoAcceleration",
    "OperatorFolder",
    "Orthotropic",
    "Output",
    "Periodic",
    "Place",
    "PointMass",
    "Polynomial",
    "Port",
    "PrescribedAcceleration",
    "PrescribedDisplacement",
    "PrescribedVelocity",
    "PsdLaw",
    "RectangularPulseLaw",
    "ReducedPropagator",
    "Rotation",
    "Row",
    "Sensor",
    "Solver",
    "Spectrum",
    "Spring",
    "SrsLaw",
    "StaticStart",
    "StepLaw",
    "Substructure",
    "Symmetry",
    "TableLaw",
    "Temperature",
    "Thread",
    "Time",
    "Uniform",
    "VelocityFile",
]
