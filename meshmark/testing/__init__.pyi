from .attacks import AttackSuite as AttackSuite
from .binned_schemes import BinnedSchemeSuite as BinnedSchemeSuite
from .geodesics import GeodesicSolverSuite as GeodesicSolverSuite
from .informed_schemes import InformedSchemeSuite as InformedSchemeSuite
from .readers import ReaderSuite as ReaderSuite
from .schemes import SchemeSuite as SchemeSuite
from .segmenters import SegmenterSuite as SegmenterSuite
