"""Numba kernels: float64 arrays in and out, an int status, no classes; one file a subject."""
