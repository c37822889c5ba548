"""Judging: fair comparison of drives, scores of the observer and the map against the truth."""
