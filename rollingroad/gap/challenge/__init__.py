"""Blind cases from a generator that shares no code with the plant; their sealed keys; their scores."""
