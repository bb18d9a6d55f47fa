"""Feet: where each foot shall be, and why, decided frame by frame in compiled code."""
