"""The (k,m)-segment mean and the search for k and m (thesis, sections 6.1, 6.3 and 6.4)."""
