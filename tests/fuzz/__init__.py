"""Alters small inputs at random and runs commands on them; `python -m fuzz --help` in tests/."""
