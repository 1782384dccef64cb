"""Figures in millimetres, axes with equal scales, and the lines of maps, with matplotlib."""
