"""Optimal control: Pontryagin's principle and its rivals, and the advice that comes of it."""
