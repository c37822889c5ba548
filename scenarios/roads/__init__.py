"""Roads that ship with the project: the design in Python, its plain XML beside it (see `draft.py`)."""
