"""The 1-segment coreset: moments of a block of samples that price any line (thesis, section 6.2)."""
