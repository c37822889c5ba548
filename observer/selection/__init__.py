"""Which sensors are worth having (seed 003): H2 observer design with few sensors, brute force, a car's candidates."""

from observer.selection.h2 import LinearSystem, kalman_h2
from observer.selection.process_noise import process_noise
from observer.selection.search import Choice, best_sets, brute_force
from observer.selection.sparse import Design, SparseDesign, sweep

__all__ = [
    "Choice",
    "Design",
    "LinearSystem",
    "SparseDesign",
    "best_sets",
    "brute_force",
    "kalman_h2",
    "process_noise",
    "sweep",
]
