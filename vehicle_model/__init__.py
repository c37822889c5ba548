"""The car: files and parameters (`car`), and the physics that drives it (`plant`)."""
