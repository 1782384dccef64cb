"""Settings of all tests: how random tests run."""

import os

from hypothesis import settings

# No deadline: the first example may wait for the compiler. Continuous integration tries the same
# examples each time, so that no change fails by chance; elsewhere new ones are tried.
settings.register_profile(
    "gpszip", deadline=None, derandomize=bool(os.environ.get("CI")), print_blob=True
)
settings.load_profile("gpszip")
