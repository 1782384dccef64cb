"""What all tests share: how random ones run."""

import os

from hypothesis import settings

# The first example may wait for the compiler. What a change has to pass must not depend on luck; at a desk, luck finds more.
settings.register_profile(
    "gpszip", deadline=None, derandomize=bool(os.environ.get("CI")), print_blob=True
)
settings.load_profile("gpszip")
