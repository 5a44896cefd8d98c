"""Reports: one HTML page on a copy, or on a marked file, that needs nothing beside it."""
