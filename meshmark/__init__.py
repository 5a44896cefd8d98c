"""Blind, robust marks for animated meshes.

Mark on publish, and later say from a leaked copy alone, and a secret key: ours, whose copy,
and with what probability of being wrong.
"""

import sys

# `python -m` puts the working directory first on the import path, and calls the program "-m" while
# it looks for the module. Nothing there is to be imported, `__future__` and `typing` neither.
if sys.argv[:1] == ["-m"] and not sys.flags.safe_path:
    del sys.path[0]

import lazy_loader

# Names come from the modules that `__init__.pyi` lists when they are first asked for: numpy and
# scipy take half a second to import, which those who ask for help should not have to wait for.
__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
