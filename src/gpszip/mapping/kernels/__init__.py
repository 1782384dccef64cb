"""Compiled kernels of map learning; only the package ``mapping`` calls them."""
