"""A low relief on every surface, read against the original.

Patches (`patches.py`) carry signed chips, which `basis.py` turns into smooth heights. `height.py`
bounds them, `plan.py` moves the vertices. To read a copy, `residual.py` measures its heights above
the original, and `chips.py` estimates the chips. docs/relief.md tells it all.
"""
