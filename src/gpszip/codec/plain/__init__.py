"""A decoder of walks payloads in plain Python, for small ones: it needs no compiler."""
