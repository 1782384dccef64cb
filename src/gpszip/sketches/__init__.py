"""Coresets: moments of blocks of samples that bound the cost of any k-segment (thesis, 6.2)."""
