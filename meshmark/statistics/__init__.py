"""Pure numbers: e-values, p-values, and sums over assignments of words."""
