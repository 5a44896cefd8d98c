"""USD stages in; override layers, flattened deliverables and new stages out.

Import the modules of this package only where they are used: they import pxr.
"""
