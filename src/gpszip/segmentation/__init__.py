"""The (k,m)-segment mean, and the search for k and m (thesis, sections 6.1, 6.3 and 6.4).

A track is cut into k intervals of consecutive samples. Each interval is assigned to one of m
directed segments and runs along it from start to end at constant speed. The fitting cost tau is
the weighted sum of the squared distances between samples and positions on the segments.
"""
