"""Linear algebra that chips and marking share."""
