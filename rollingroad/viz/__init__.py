"""Seeing a run: the report, the recording for rerun, figures, the driver's display."""
