"""The ledger: which copy of which asset was made for whom, entry after entry, in one chain."""
