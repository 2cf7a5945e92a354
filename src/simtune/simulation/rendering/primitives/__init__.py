"""Simple shapes, drawn fast by kernels of our own."""
