"""Conformance suites a plugin author subclasses, and meshes to test on.

`AttackSuite`, `BinnedSchemeSuite`, `GeodesicSolverSuite`, `InformedSchemeSuite`, `ReaderSuite`,
`SchemeSuite` and `SegmenterSuite` need pytest, which is imported only when one of them is asked
for.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
