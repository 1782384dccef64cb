"""A clean map from the walks of an archive: one centreline for each street."""
