"""The figures of the thesis (seed 004), made from our own runs, numbered as there."""
