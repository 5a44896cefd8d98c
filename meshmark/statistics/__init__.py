"""P-values of evidence: e-values, and their means over hypotheses and assignments of words."""
