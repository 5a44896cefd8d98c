"""How the demonstration's creature is modelled; `make_creature.py` runs it."""
