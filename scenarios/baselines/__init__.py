"""The regression suite: more scenarios, what was found in each when last accepted, and how far that may move."""
